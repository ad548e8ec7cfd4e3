// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>

#include "natural_order.hpp"

namespace all_in_focus {
namespace {

using Names = std::vector<std::string>;

class InOrder : public testing::TestWithParam<Names> {};

TEST_P(InOrder, FromAnyOther) {
  Names names = GetParam();
  std::sort(names.begin(), names.end());
  EXPECT_EQ(inNaturalOrder(names), GetParam());
  std::reverse(names.begin(), names.end());
  EXPECT_EQ(inNaturalOrder(names), GetParam());
}

INSTANTIATE_TEST_SUITE_P(
    NaturalOrder, InOrder,
    testing::Values(Names{"1.jpg", "2.jpg", "10.jpg"}, Names{"a.jpg", "B.jpg", "c.JPG", "D.jpg"},
                    Names{"img (1).png", "img (2).png", "img (10).png"},
                    Names{"img.png", "img (1).png", "img (2).png"}, Names{"9.jp2", "10.jp2", "11.jp2"},
                    Names{"z-10.png", "z-2.png", "z0.png", "z2.png", "z10.png"},
                    Names{"z-2.png", "z-1.png", "z+1.png", "z+10.png"},
                    Names{"shot-1.png", "shot-2.png", "shot-10.png"},
                    Names{"0.5m.png", "1m.png", "1.5m.png", "2.25m.png", "2.5m.png", "10m.png"},
                    Names{"0,5.png", "2,25.png", "2,5.png"}, Names{"s 1.9.png", "s 1.10.png", "s 1.11.png"},
                    Names{"2024-11-26 10.00.09.png", "2024-11-26 10.00.10.png"},
                    Names{"1.2.9.png", "1.2.10.png", "1.10.1.png"}, Names{"set 0.25", "set 0.5", "set 1.5"},
                    Names{"99999999999999999999.png", "100000000000000000000.png"},
                    Names{"1_focus.png", "2_focus.png", "10_focus.png"}));

TEST(NaturalOrder, FindsWhereACounterBeganAnew) {
  EXPECT_EQ(firstAfterRollOver({"DSC_0001.JPG", "DSC_0002.JPG", "DSC_9998.JPG", "DSC_9999.JPG"}), 2U);
  EXPECT_EQ(firstAfterRollOver({"IMG_0000.JPG", "IMG_9999.JPG"}), 1U);
  EXPECT_EQ(firstAfterRollOver({"DSC00001.ARW", "DSC09998.ARW", "DSC09999.ARW"}), 1U);
  EXPECT_EQ(firstAfterRollOver({"a_00001.png", "a_99999.png"}), 1U);
  EXPECT_EQ(firstAfterRollOver({"IMG_0001.jpg", "IMG_9999.JPG"}), 1U);
}

TEST(NaturalOrder, TakesNoGapForANewCount) {
  EXPECT_EQ(firstAfterRollOver({"DSC_0001.JPG", "DSC_0002.JPG", "DSC_0400.JPG"}), 0U);
  EXPECT_EQ(firstAfterRollOver({"1.jpg", "9.jpg"}), 0U);
  EXPECT_EQ(firstAfterRollOver({"A_0001.JPG", "B_9999.JPG"}), 0U);
  EXPECT_EQ(firstAfterRollOver({"mm_0500.png", "mm_1000.png", "mm_9000.png"}), 0U);
  EXPECT_EQ(firstAfterRollOver({"DSC_0001.JPG"}), 0U);
  EXPECT_EQ(firstAfterRollOver({}), 0U);
}

}  // namespace
}  // namespace all_in_focus
