// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/edge_rows.hpp"

#include <cstring>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

using Mask = std::uint8_t;  // 0 or 255, as vector comparisons give

inline Mask mask(bool value) {
  return value ? 255 : 0;
}

struct BlockEdge {
  std::uint8_t weight;
  Mask same;      // its ends have the same label
  Mask drop = 0;  // it comes after another edge between the same two labels
};

// If the two edges join the same two labels, drops the later one in Kruskal's order. `first` comes first in
// raster order.
inline void dropLater(Mask same_labels, BlockEdge& first, BlockEdge& second) {
  const Mask in_order = mask(first.weight <= second.weight);
  second.drop |= same_labels & in_order;
  first.drop |= static_cast<Mask>(same_labels & ~in_order);
}

// The edges of a triangle in raster order. If one joins equal labels, the other two join the same two labels.
inline void dropInTriangle(BlockEdge& p, BlockEdge& q, BlockEdge& r) {
  dropLater(p.same, q, r);
  dropLater(q.same, p, r);
  dropLater(r.same, p, q);
}

}  // namespace

ALL_IN_FOCUS_SIMD
void weighEdges(const std::uint16_t* p, const std::uint16_t* q, int n, std::uint8_t* weight) {
  for (int x = 0; x < n; ++x) {
    const std::uint16_t low = p[x] < q[x] ? p[x] : q[x], high = p[x] < q[x] ? q[x] : p[x];
    const std::uint16_t difference = high - low;
    const std::uint16_t held = difference < kHeavy ? difference : kHeavy;
    weight[x] = static_cast<std::uint8_t>(low == 0 ? kHeavy : held);
  }
}

ALL_IN_FOCUS_SIMD
void findLinks(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* limit,
               const std::uint8_t* limit_below, int n, BlockRow* blocks) {
  const std::uint8_t *ab_row = row.ab, *ac_row = row.ac, *ad_row = row.ad, *bc_row = row.bc;
  for (int x = 0; x < n; ++x) {
    const Mask ab = mask(ab_row[x] <= limit[x]), ac = mask(ac_row[x] <= limit[x]),
               ad = mask(ad_row[x] <= limit[x]), bc = mask(bc_row[x] <= limit[x + 1]),
               bd = mask(ac_row[x + 1] <= limit[x + 1]), cd = mask(ab_below[x] <= limit_below[x]);
    blocks[x] =
        static_cast<BlockRow>((ab & kEast) | (ac & kSouth) | (ad & ~(ab & bd) & ~(ac & cd) & kSouthEast) |
                              (bc & ~(ab & ac) & ~(bd & cd) & kSouthWest) | (~(ab & ac & cd) & kKeepsBd));
  }
}

ALL_IN_FOCUS_SIMD
void findSame(const std::int32_t* row, const std::int32_t* below, int n, std::uint8_t* same) {
  for (int x = 0; x < n; ++x) {
    const std::int32_t a = row[x], b = row[x + 1], c = below[x], d = below[x + 1];
    same[x] = static_cast<std::uint8_t>((a == b ? kEast : 0) | (a == c ? kSouth : 0) |
                                        (a == d ? kSouthEast : 0) | (b == c ? kSouthWest : 0));
  }
}

ALL_IN_FOCUS_SIMD
void findAdjacencies(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* same,
                     const std::uint8_t* same_below, int n, BlockRow* blocks) {
  const std::uint8_t *ab_row = row.ab, *ac_row = row.ac, *ad_row = row.ad, *bc_row = row.bc;
  for (int x = 0; x < n; ++x) {
    BlockEdge ab{ab_row[x], mask((same[x] & kEast) != 0)}, ac{ac_row[x], mask((same[x] & kSouth) != 0)},
        ad{ad_row[x], mask((same[x] & kSouthEast) != 0)}, bc{bc_row[x], mask((same[x] & kSouthWest) != 0)},
        bd{ac_row[x + 1], mask((same[x + 1] & kSouth) != 0)},
        cd{ab_below[x], mask((same_below[x] & kEast) != 0)};
    dropInTriangle(ab, ac, bc);
    dropInTriangle(ab, ad, bd);
    dropInTriangle(ac, ad, cd);
    dropInTriangle(bc, bd, cd);
    // A byte does not tell which of two heavy edges is lighter: both stay.
    const auto dropped = [](const BlockEdge& edge) -> Mask {
      return edge.drop & mask(edge.weight != kHeavy);
    };
    const auto kept = [&](const BlockEdge& edge) -> Mask { return ~edge.same & ~dropped(edge); };
    blocks[x] = static_cast<BlockRow>((kept(ab) & kEast) | (kept(ac) & kSouth) | (kept(ad) & kSouthEast) |
                                      (kept(bc) & kSouthWest) | (~dropped(bd) & kKeepsBd) |
                                      (~dropped(cd) & kKeepsCd));
  }
}

ALL_IN_FOCUS_SIMD
void gatherLinks(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* links) {
  for (int x = 0; x < n; ++x) {
    const BlockRow north = blocks_above[x] & (blocks_above[x - 1] >> 2) & kSouth;
    links[x] =
        static_cast<std::uint8_t>((blocks[x - 1] & kEast) | (north >> 1) |
                                  ((blocks_above[x] & kSouthWest) << 1) | (blocks_above[x - 1] & kSouthEast));
  }
}

ALL_IN_FOCUS_SIMD
void takeFirstLinks(std::uint8_t* links, int first, int stride, int n, std::int32_t* linked_to) {
  for (int x = 0; x < n; ++x) {
    const std::int32_t link = links[x];
    std::int32_t back = (link & kNorthWest) != 0 ? stride + 1 : 0;
    back = (link & kNorthEast) != 0 ? stride - 1 : back;
    back = (link & kNorth) != 0 ? stride : back;
    back = (link & kWest) != 0 ? 1 : back;
    linked_to[x] = first + x - back;
  }
  for (int x = 0; x < n; ++x) links[x] &= static_cast<std::uint8_t>(links[x] - 1);
}

ALL_IN_FOCUS_SIMD
void gatherEdges(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* edges) {
  for (int x = 0; x < n; ++x) {
    edges[x] = (blocks[x] & kSouthEast) | (blocks[x] & (blocks[x - 1] >> 2) & kSouth) |
               (blocks[x] & (blocks_above[x] >> 5) & kEast) | (blocks[x - 1] & kSouthWest);
  }
}

ALL_IN_FOCUS_SIMD
int listBits(const std::uint8_t* bits, int n, std::uint32_t* list) {
  static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the first pixel has the lowest bits");
  std::uint32_t* next = list;
  for (int x = 0; x < n; x += 8) {
    std::uint64_t left;
    std::memcpy(&left, bits + x, 8);
    if (left == 0) continue;
    std::uint32_t* const end = next + __builtin_popcountll(left);
    // By fours, past the end if need be: a loop over the exact number would often mispredict its end.
    do {
      for (int i = 0; i < 4; ++i) {
        *next++ = 8 * x + __builtin_ctzll(left | std::uint64_t{1} << 63);
        left &= left - 1;
      }
    } while (next < end);
    next = end;
  }
  return static_cast<int>(next - list);
}

}  // namespace all_in_focus::core
