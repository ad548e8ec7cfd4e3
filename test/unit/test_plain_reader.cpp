// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Linked with a reader of pictures that is compiled without LibRaw and libheif.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

#include "picture_reader.hpp"
#include "stack_reader.hpp"

namespace fs = std::filesystem;
using namespace all_in_focus;

namespace {

std::string complaintOf(const std::string& path) {
  try {
    const StackReader stack(path);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(PlainReader, NamesWhatItCannotRead) {
  const fs::path folder = fs::temp_directory_path() / "all_in_focus_plain_reader";
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const char* name : {"1.NEF", "2.heic"}) std::ofstream(folder / name) << "a picture";
  const std::string why =
      "left out 1.NEF: camera raw files cannot be read: develop them first, or build with LibRaw";
  EXPECT_EQ(complaintOf(folder.string()),
            folder.string() + ": the folder holds no image: " + folder.string() + ": " + why);
  EXPECT_THROW(readPicture((folder / "1.NEF").string()), std::invalid_argument);
  EXPECT_THROW(readPicture((folder / "2.heic").string()), std::invalid_argument);

  for (const char* name : {"1.png", "2.png"}) cv::imwrite((folder / name).string(), cv::Mat(4, 4, CV_8UC3));
  const StackReader stack(folder.string());
  EXPECT_EQ(stack.names(), (std::vector<std::string>{"1.png", "2.png"}));
  ASSERT_EQ(stack.notes().size(), 2u);
  EXPECT_NE(stack.notes()[0].find(why), std::string::npos) << stack.notes()[0];
  EXPECT_NE(stack.notes()[1].find("left out 2.heic: pictures of this format cannot be read: convert them"),
            std::string::npos)
      << stack.notes()[1];
  fs::remove_all(folder);
}

}  // namespace
