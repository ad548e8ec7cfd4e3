// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "neighbour_rows.hpp"

#include <cstring>

#include "simd.hpp"

namespace all_in_focus::core {
namespace {

using Mask = std::uint8_t;  // 0 or 255: what a vector comparison gives

inline Mask mask(bool value) {
  return value ? 255 : 0;
}

// Of two edges between the same two labels, `first` being the earlier one at equal weights, the later is
// dropped.
inline void dropLater(Mask same_labels, std::uint8_t first, std::uint8_t second, Mask& drop_first,
                      Mask& drop_second) {
  const Mask in_order = mask(first <= second);
  drop_second |= same_labels & in_order;
  drop_first |= same_labels & ~in_order;
}

}  // namespace

ALL_IN_FOCUS_SIMD
void weighEdges(const std::uint16_t* p, const std::uint16_t* q, int n, std::uint8_t* weight) {
  for (int x = 0; x < n; ++x) {
    const std::uint16_t low = p[x] < q[x] ? p[x] : q[x], high = p[x] < q[x] ? q[x] : p[x];
    const std::uint16_t difference = high - low;
    const std::uint16_t held = difference < kHeavy ? difference : kHeavy;
    weight[x] = low == 0 ? kHeavy : held;
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
    blocks[x] = (ab & kEast) | (ac & kSouth) | (ad & ~(ab & bd) & ~(ac & cd) & kSouthEast) |
                (bc & ~(ab & ac) & ~(bd & cd) & kSouthWest) | (~(ab & ac & cd) & kAdmitsBd);
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
void findBorders(const WeightRow& row, const std::uint8_t* ab_below, const std::uint8_t* same,
                 const std::uint8_t* same_below, std::uint8_t limit, int n, BlockRow* blocks) {
  const std::uint8_t *ab_row = row.ab, *ac_row = row.ac, *ad_row = row.ad, *bc_row = row.bc;
  for (int x = 0; x < n; ++x) {
    const std::uint8_t ab = ab_row[x], ac = ac_row[x], ad = ad_row[x], bc = bc_row[x], bd = ac_row[x + 1],
                       cd = ab_below[x];
    const Mask same_ab = mask((same[x] & kEast) != 0), same_ac = mask((same[x] & kSouth) != 0),
               same_ad = mask((same[x] & kSouthEast) != 0), same_bc = mask((same[x] & kSouthWest) != 0),
               same_bd = mask((same[x + 1] & kSouth) != 0), same_cd = mask((same_below[x] & kEast) != 0);
    Mask drop_ab = 0, drop_ac = 0, drop_ad = 0, drop_bc = 0, drop_bd = 0, drop_cd = 0;
    // The four triangles. Raster order of the edges is ab, ac, ad, bc, bd, cd.
    dropLater(same_ab, ac, bc, drop_ac, drop_bc);
    dropLater(same_ac, ab, bc, drop_ab, drop_bc);
    dropLater(same_bc, ab, ac, drop_ab, drop_ac);
    dropLater(same_ab, ad, bd, drop_ad, drop_bd);
    dropLater(same_ad, ab, bd, drop_ab, drop_bd);
    dropLater(same_bd, ab, ad, drop_ab, drop_ad);
    dropLater(same_ac, ad, cd, drop_ad, drop_cd);
    dropLater(same_ad, ac, cd, drop_ac, drop_cd);
    dropLater(same_cd, ac, ad, drop_ac, drop_ad);
    dropLater(same_bc, bd, cd, drop_bd, drop_cd);
    dropLater(same_bd, bc, cd, drop_bc, drop_cd);
    dropLater(same_cd, bc, bd, drop_bc, drop_bd);
    // Heavy edges cannot be compared: they stay.
    const auto wanted = [limit](std::uint8_t weight, Mask same_labels, Mask drop) -> Mask {
      return mask(weight <= limit) & ~same_labels & ~(drop & mask(weight != kHeavy));
    };
    blocks[x] = (wanted(ab, same_ab, drop_ab) & kEast) | (wanted(ac, same_ac, drop_ac) & kSouth) |
                (wanted(ad, same_ad, drop_ad) & kSouthEast) | (wanted(bc, same_bc, drop_bc) & kSouthWest) |
                (~(drop_bd & mask(bd != kHeavy)) & kAdmitsBd) | (~(drop_cd & mask(cd != kHeavy)) & kAdmitsCd);
  }
}

ALL_IN_FOCUS_SIMD
void gatherLinks(const BlockRow* blocks, const BlockRow* blocks_above, int n, std::uint8_t* links) {
  for (int x = 0; x < n; ++x) {
    const BlockRow north = blocks_above[x] & (blocks_above[x - 1] >> 2) & kSouth;
    links[x] = (blocks[x - 1] & kEast) | (north >> 1) | ((blocks_above[x] & kSouthWest) << 1) |
               (blocks_above[x - 1] & kSouthEast);
  }
}

ALL_IN_FOCUS_SIMD
void takeFirstLinks(std::uint8_t* links, int first, int stride, int n, std::int32_t* parents) {
  for (int x = 0; x < n; ++x) {
    const std::int32_t link = links[x];
    std::int32_t back = (link & kNorthWest) != 0 ? stride + 1 : 0;
    back = (link & kNorthEast) != 0 ? stride - 1 : back;
    back = (link & kNorth) != 0 ? stride : back;
    back = (link & kWest) != 0 ? 1 : back;
    parents[x] = first + x - back;
  }
  for (int x = 0; x < n; ++x) links[x] &= links[x] - 1;
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
    // By fours, past the end if need be: how many there are cannot be guessed.
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
