// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

/// The bytes of .oni recordings, version 1.0.1.0.
namespace all_in_focus::oni {

template <typename T>
std::string bytesOf(T value) {
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

inline std::string textOf(const std::string& text) {
  return bytesOf(static_cast<std::uint32_t>(text.size() + 1)) + text + '\0';
}

inline std::string fileHeader(std::uint32_t last_node = 1, std::uint16_t version = 1,
                              std::uint16_t maintenance = 1) {
  return "NI10" + bytesOf(version) + bytesOf(maintenance) + bytesOf<std::uint32_t>(0) +
         bytesOf<std::uint64_t>(0) + bytesOf(last_node);
}

inline std::string record(std::uint32_t type, const std::string& fields, std::uint32_t node = 1) {
  return std::string("NIR\0", 4) + bytesOf(type) + bytesOf(node) +
         bytesOf(static_cast<std::uint32_t>(28 + fields.size())) + bytesOf<std::uint32_t>(0) +
         bytesOf<std::uint64_t>(0) + fields;
}

inline std::string added(std::uint64_t index, std::uint32_t images = 12) {
  return record(13, textOf("Depth") + "\2\0\0\0" + std::string("\0\0\0", 3) + "16zT" + bytesOf(images) +
                        bytesOf<std::uint64_t>(0) + bytesOf<std::uint64_t>(9) + bytesOf(index));
}

const std::string kNumber =
    record(3, textOf("xnMirror") + bytesOf<std::uint32_t>(8) + bytesOf<std::uint64_t>(1));
const std::string kText = record(5, textOf("xnName") + textOf("depth"));
const std::string kTable = record(6, textOf("S2D") + bytesOf<std::uint32_t>(3) + "abc");
const std::string kImage = record(10, bytesOf<std::uint64_t>(0) + bytesOf<std::uint32_t>(1)) + "pixels";
const std::string kWhole = fileHeader() + added(0) + kNumber + kText + kTable + record(9, "") + kImage;

}  // namespace all_in_focus::oni
