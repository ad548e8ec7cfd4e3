// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

/// Loops over one row of the pixel graph: a byte per pixel in, a byte per pixel out, so that the compiler
/// vectorises them.
///
/// Each pixel a is the corner of a block of 2 x 2 pixels with six edges, of which ab, ac, ad and bc are
/// stored with the block. Its edges bd and cd are stored with the blocks of b and c.
///
///     a--b
///     |\/|
///     |/\|
///     c--d
///
/// A block decides from its six edges alone which of them it keeps. ab and cd, and ac and bd, are seen by two
/// blocks, and stay only if both keep them.
namespace all_in_focus::core {

/// The four edges that belong to a pixel, in Kruskal's order.
enum EdgeBit : std::uint8_t { kEast = 1, kSouthWest = 2, kSouth = 4, kSouthEast = 8 };

/// Weights of the edges of a row of blocks, |depth difference| in mm: 0..254 as they are, kHeavy for more and
/// for unknown depth.
struct WeightRow {
  const std::uint8_t *ab, *ac, *ad, *bc;
};
constexpr std::uint8_t kHeavy = 255;

/// Weights of the edges from p[x] to q[x]. p, q: depth in mm, 0 = unknown.
void weighEdges(const std::uint16_t* p, const std::uint16_t* q, int n, std::uint8_t* weight);

/// What a block keeps: EdgeBit of ab (kEast), bc (kSouthWest), ac (kSouth) and ad (kSouthEast), and these for
/// bd and cd.
using BlockRow = std::uint8_t;
constexpr BlockRow kKeepsBd = 16, kKeepsCd = 32;

/// Edges no heavier than `limit`, less those that close a circle inside the block. An edge has the limit of
/// the pixel it is stored with: that of b for bc and bd, of c for cd, of a for the others. No block drops cd,
/// and kKeepsCd is not set. Reads elements 0..n of all rows.
void findLinks(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* limit,
               const std::uint8_t* limit_below, int n, BlockRow* blocks);

/// EdgeBit of the edges that join equal labels, those of the block of each pixel. Reads elements 0..n.
void findSame(const std::int32_t* row, const std::int32_t* below, int n, std::uint8_t* same);

/// Edges between different labels, less those that come after another one between the same two labels in the
/// block (see adjacency_edges.hpp). same, same_below: from findSame(). Reads elements 0..n of all rows.
void findAdjacencies(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* same,
                     const std::uint8_t* same_below, int n, BlockRow* blocks);

/// Links of each pixel to pixels before it in raster order: LinkBit, from the blocks of its row and of the
/// row above. Reads elements -1..n-1.
enum LinkBit : std::uint8_t { kWest = 1, kNorth = 2, kNorthEast = 4, kNorthWest = 8 };
void gatherLinks(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* links);

/// Removes the first link of each pixel from `links` and writes the index of the pixel that it leads to; that
/// of the pixel itself if there is no link. first: index of the row's first pixel, stride: from a pixel to
/// the one below.
void takeFirstLinks(std::uint8_t* links, int first, int stride, int n, std::int32_t* linked_to);

/// EdgeBit of each pixel's own edges that all blocks keep. Reads elements -1..n-1.
void gatherEdges(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* edges);

/// Lists the bits 0..3 of all pixels in their order as 8 x + bit, and returns their number. bits must be 0
/// from n up to the next multiple of 8; list needs room for kMostBits(n).
int listBits(const std::uint8_t* bits, int n, std::uint32_t* list);
constexpr int kMostBits(int n) {
  return 4 * n + 8;
}

}  // namespace all_in_focus::core
