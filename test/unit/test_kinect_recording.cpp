// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "kinect_recording.hpp"
#include "oni_bytes.hpp"

namespace all_in_focus {
namespace {

namespace fs = std::filesystem;
using namespace oni;

class RecordingTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string folder = testing::TempDir() + "recording_XXXXXX";
    ASSERT_NE(mkdtemp(&folder[0]), nullptr);
    folder_ = folder;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string refusal(const std::string& path) const {
    try {
      requireRecording(path);
    } catch (const std::runtime_error& e) {
      const std::string text = e.what(), begin = "cannot open \"" + path + "\"";
      EXPECT_EQ(text.substr(0, begin.size()), begin);
      EXPECT_NE(text.find(" (parameter device): "), std::string::npos) << text;
      EXPECT_EQ(text.find('\n'), std::string::npos);
      return text;
    }
    return "";
  }
  std::string refusalOf(const std::string& bytes) const {
    std::ofstream(folder_ / "x.oni", std::ios::binary) << bytes;
    return refusal((folder_ / "x.oni").string());
  }
  void expectRefused(const std::string& bytes, const std::string& why) const {
    EXPECT_NE(refusalOf(bytes).find(why), std::string::npos) << refusalOf(bytes);
  }

  fs::path folder_;
};

TEST_F(RecordingTest, FilesAreToldFromUris) {
  for (const char* name : {"/data/x.oni", "x.oni", "../x.oni", "file:///x.oni", "/data/x"})
    EXPECT_TRUE(isFileName(name)) << name;
  for (const char* uri : {"", "#2", "frames:one", "freenect://0", "1d27/0601@1/6", "driver:/data/x.oni"})
    EXPECT_FALSE(isFileName(uri)) << uri;
}

TEST_F(RecordingTest, WholeOnesPass) {
  EXPECT_EQ(refusalOf(kWhole), "");
  // A recorder that was killed leaves no count and no index.
  EXPECT_EQ(refusalOf(fileHeader() + added(0, 0xffffffff) + kImage), "");
}

TEST_F(RecordingTest, WhatIsNoReadableFile) {
  const auto expect = [this](const std::string& path, const std::string& why) {
    EXPECT_NE(refusal(path).find(why), std::string::npos) << refusal(path);
  };
  expect((folder_ / "x.oni").string(), "there is no such file; it is played as soon as it is there");
  expect("missing.oni", "\" in " + fs::current_path().string());
  expect(folder_.string(), "it is a folder");
  expect("/dev/null", "it is not a file");
  expect("file:///x.oni", "give the name of the file, without file://");
  fs::create_symlink("loop.oni", folder_ / "loop.oni");
  expect((folder_ / "loop.oni").string(), "it cannot be read (Too many levels of symbolic links)");
}

TEST_F(RecordingTest, OtherFilesAndDamagedOnes) {
  expectRefused("", "it is empty");
  expectRefused("not\n", "it is not an .oni recording");
  expectRefused("Some text that was given the name of a recording.\n", "it is not an .oni recording");
  expectRefused(fileHeader(1, 2) + added(0) + kImage, "OpenNI2 does not play its version");
  expectRefused(fileHeader(3997697) + added(0) + kImage, "it claims to have 3997697 streams");
  for (std::size_t bytes : {4, 23, 24, 60, 150})
    expectRefused(kWhole.substr(0, bytes), "it ends before its first image");
  expectRefused(fileHeader() + added(5000) + kImage, "it is cut short: it has 144 bytes of at least 5288");
  expectRefused(fileHeader() + added(UINT64_MAX - 99) + kImage, "it is cut short");
  expectRefused(fileHeader() + added(0, 0) + record(7, "") + record(11, "", 0), "it holds no images");
  expectRefused(fileHeader() + added(0) + "rubbish" + kWhole, "does not begin where it should (byte 98)");
  expectRefused(fileHeader() + added(0) + record(99, ""), "a record is of an unknown kind");
  expectRefused(fileHeader() + added(0) + record(9, "", 7), "a record belongs to an unknown stream");
  expectRefused(fileHeader() + record(6, textOf("S2D") + bytesOf(1000) + "abc"), "longer than its record");
  expectRefused(fileHeader() + record(3, textOf("xnMirror") + bytesOf(16) + std::string(16, '1')),
                "a number has another size than 8 bytes");
  expectRefused(fileHeader() + record(5, textOf("xnName") + bytesOf(3) + "abc"), "a text has no end");
  expectRefused(fileHeader() + record(3, textOf("xn\xff") + bytesOf(8) + std::string(8, '1')),
                "a name has impossible characters");
}

}  // namespace
}  // namespace all_in_focus
