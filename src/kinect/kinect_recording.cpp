// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_recording.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

namespace all_in_focus {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kMaxNodes = 256;           // streams; recorders number them from 1
constexpr std::uint32_t kMaxFieldBytes = 1 << 20;  // in a record; the tables of a PrimeSense take 20 kB

// An .oni file, all of it little-endian: magic "NI10", version (1, 1, 2, 4 bytes), end time (8), last node
// (4); then records: magic "NIR\0", type, node, bytes of header and fields, bytes of payload (4 each),
// position of the record it replaces (8; 4 before version 1.0.1.0); fields; payload.
enum RecordType : std::uint32_t {
  kNodeAdded4 = 2,  // in version 1.0.0.4
  kIntProperty = 3,
  kRealProperty = 4,
  kStringProperty = 5,
  kGeneralProperty = 6,
  kNewData = 10,
  kEnd = 11,
  kNodeAdded5 = 12,  // in version 1.0.0.5
  kNodeAdded = 13,
  kSeekTable = 14,
};

struct Damage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Reads values from a buffer one after the other.
class Bytes {
 public:
  explicit Bytes(std::vector<char> bytes) : bytes_(std::move(bytes)) {}

  std::string take(std::size_t count) {
    const char* const begin = skip(count);
    return {begin, begin + count};
  }
  const char* skip(std::size_t count) {
    if (count > bytes_.size() - at_) throw Damage("a field is longer than its record");
    at_ += count;
    return bytes_.data() + at_ - count;
  }
  template <typename T>
  T number() {
    T value;
    std::memcpy(&value, skip(sizeof value), sizeof value);
    return value;
  }
  /// Checks and skips a name: the player uses its characters as indices into a table.
  void skipName() {
    const std::string name = take(number<std::uint32_t>());
    const auto is_plain = [](char c) { return c >= ' ' && c <= '~'; };
    if (name.size() < 2 || name.back() != 0 || !std::all_of(name.begin(), name.end() - 1, is_plain))
      throw Damage("a name has impossible characters");
  }

 private:
  const std::vector<char> bytes_;
  std::size_t at_ = 0;
};

class Recording {
 public:
  explicit Recording(const std::string& path) : file_(path, std::ios::binary), size_(fs::file_size(path)) {}

  void check() {
    std::string magic(4, '\0');
    if (!file_.read(&magic[0], 4) || magic != "NI10") throw Damage("it is not an .oni recording");
    Bytes header = read(20);
    // OpenNI2 plays versions from 1.0.0.4; 1.0.1.0 is the newest.
    const auto version = header.number<std::uint16_t>(), maintenance = header.number<std::uint16_t>();
    if (version != 1 || maintenance > 1) throw Damage("OpenNI2 does not play its version");
    is_old_ = maintenance == 0;
    header.skip(12);  // build, end time
    last_node_ = header.number<std::uint32_t>();
    if (last_node_ >= kMaxNodes) throw Damage("it claims to have " + std::to_string(last_node_) + " streams");
    while (checkRecord()) position_ = static_cast<std::uint64_t>(file_.tellg());
  }
  std::uint64_t position() const { return position_; }

 private:
  Bytes read(std::size_t count) {
    std::vector<char> bytes(count);
    if (!file_.read(bytes.data(), static_cast<std::streamsize>(count)))
      throw Damage("it ends before its first image");
    return Bytes(std::move(bytes));
  }

  std::uint32_t headerBytes() const { return is_old_ ? 24 : 28; }

  /// False when the first image is reached.
  bool checkRecord() {
    Bytes header = read(headerBytes());
    if (header.take(4) != std::string("NIR\0", 4)) throw Damage("a record does not begin where it should");
    const auto type = header.number<std::uint32_t>(), node = header.number<std::uint32_t>(),
               bytes = header.number<std::uint32_t>(), payload = header.number<std::uint32_t>();
    if (type < kNodeAdded4 || type > kSeekTable) throw Damage("a record is of an unknown kind");
    if (node > last_node_) throw Damage("a record belongs to an unknown stream");
    if (bytes < headerBytes() || bytes > kMaxFieldBytes) throw Damage("a record has an impossible length");
    if (type == kEnd) throw Damage("it holds no images");
    if (type == kNewData) return false;
    checkFields(type, read(bytes - headerBytes()));
    if (type == kSeekTable) file_.seekg(payload, std::ios::cur);  // only in a recording without images
    return true;
  }

  void checkFields(std::uint32_t type, Bytes fields) const {
    if (type == kNodeAdded4 || type == kNodeAdded5 || type == kNodeAdded) {
      fields.skipName();
      fields.skip(8);  // kind, codec
      if (type == kNodeAdded4) return;
      const auto images = fields.number<std::uint32_t>();
      fields.skip(16);  // first and last time
      if (type == kNodeAdded5) return;
      const std::uint64_t index = is_old_ ? fields.number<std::uint32_t>() : fields.number<std::uint64_t>();
      const std::uint64_t table = headerBytes() + (std::uint64_t{images} + 1) * (is_old_ ? 16 : 20);
      const std::uint64_t end = index + std::min(table, std::numeric_limits<std::uint64_t>::max() - index);
      if (images > 0 && index > 0 && end > size_) {
        throw Damage("it is cut short: it has " + std::to_string(size_) + " bytes of at least " +
                     std::to_string(end));
      }
    } else if (type <= kGeneralProperty) {
      fields.skipName();
      const auto bytes = fields.number<std::uint32_t>();
      if (type <= kRealProperty && bytes != 8) throw Damage("a number has another size than 8 bytes");
      const std::string value = fields.take(bytes);
      if (type == kStringProperty && (value.empty() || value.back() != 0)) throw Damage("a text has no end");
    }
  }

  std::ifstream file_;
  const std::uint64_t size_;
  std::uint64_t position_ = 0;
  std::uint32_t last_node_ = 0;
  bool is_old_ = false;
};

bool endsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

}  // namespace

bool isFileName(const std::string& device) {
  std::error_code error;
  return device.rfind('/', 0) == 0 || device.rfind("file:", 0) == 0 ||
         (endsWith(device, ".oni") && device.find(':') == std::string::npos) ||
         fs::is_regular_file(device, error);
}

void requireRecording(const std::string& path) {
  // A relative name may refer to another folder than the user thinks: name the folder.
  const std::string where = path[0] == '/' ? "" : " in " + fs::current_path().string();
  const std::string cannot = "cannot open \"" + path + "\"" + where + " (parameter device): ";
  const auto fail = [&](const std::string& why) { throw std::runtime_error(cannot + why); };

  if (path.rfind("file:", 0) == 0) fail("give the name of the file, without file://");
  std::error_code error;
  const fs::file_type type = fs::status(path, error).type();
  if (type == fs::file_type::not_found) fail("there is no such file; it is played as soon as it is there");
  if (type == fs::file_type::directory) fail("it is a folder");
  if (!error && type != fs::file_type::regular) fail("it is not a file");
  errno = 0;
  if (!error && !std::ifstream(path)) error = std::error_code(errno, std::generic_category());
  if (error) fail("it cannot be read (" + error.message() + ")");
  if (fs::file_size(path) == 0) fail("it is empty");

  Recording recording(path);
  try {
    recording.check();
  } catch (const Damage& e) {
    const std::uint64_t at = recording.position();
    fail(e.what() + (at > 0 ? " (byte " + std::to_string(at) + ")" : "") + "; copy or record it again");
  }
}

}  // namespace all_in_focus
