// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

/// Loops over one row of the graph of 8 neighbours, a byte per pixel. Every pixel a heads the block of pixels
///   a b
///   c d
/// whose six edges are ab, ac, ad, bc, bd and cd; the first four belong to the block.
namespace all_in_focus::core {

/// Edges of a pixel, in their order: to its right, lower left, lower and lower right.
enum EdgeBit : std::uint8_t { kEast = 1, kSouthWest = 2, kSouth = 4, kSouthEast = 8 };

/// Weights of the edges of a row, |depth difference| in mm; 255 stands for more, and for unknown depth.
struct WeightRow {
  const std::uint8_t *ab, *ac, *ad, *bc;

  WeightRow from(int x) const { return {ab + x, ac + x, ad + x, bc + x}; }
};
constexpr std::uint8_t kHeavy = 255;

/// Weights between p[x] and q[x].
void weighEdges(const std::uint16_t* p, const std::uint16_t* q, int n, std::uint8_t* weight);

/// What each block says of its edges: EdgeBit of those to keep (kSouthWest: bc), and whether it admits bd and
/// cd, which belong to others.
using BlockRow = std::uint8_t;
constexpr BlockRow kAdmitsBd = 16, kAdmitsCd = 32;

/// Edges no heavier than `limit` (of one of their pixels), less those that close a circle of others. `admits
/// cd` is left out. Row elements 0..n are read.
void findLinks(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* limit,
               const std::uint8_t* limit_below, int n, BlockRow* blocks);

/// EdgeBit of edges between pixels of one label. Row elements 0..n are read.
void findSame(const std::int32_t* row, const std::int32_t* below, int n, std::uint8_t* same);

/// Edges no heavier than `limit` between two labels, less those that an earlier one between the same two
/// labels makes useless: see border_edges.hpp. Row elements 0..n are read.
void findBorders(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* same,
                 const std::uint8_t* same_below, std::uint8_t limit, int n, BlockRow* blocks);

/// Links of each pixel to those before it, LinkBit, from the blocks of its row and of the row above. Elements
/// -1 are read.
enum LinkBit : std::uint8_t { kWest = 1, kNorth = 2, kNorthEast = 4, kNorthWest = 8 };
void gatherLinks(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* links);

/// Takes one link of each pixel, the first, out of `links`, and gives the pixel it leads to: indices of the
/// row are first.., `stride` to the row below.
void takeFirstLinks(std::uint8_t* links, int first, int stride, int n, std::int32_t* parents);

/// EdgeBit of each pixel's own edges that all blocks admit. blocks[-1] is read.
void gatherEdges(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* edges);

/// Lists the bits of all pixels in their order, 8 x + bit, and returns their number. bits must be 0 from n up
/// to a multiple of 8; the list needs room for kMostBits(n).
int listBits(const std::uint8_t* bits, int n, std::uint32_t* list);
constexpr int kMostBits(int n) {
  return 4 * n + 8;
}

}  // namespace all_in_focus::core
