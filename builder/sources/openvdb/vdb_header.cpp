#include "builder/sources/openvdb/vdb_header.h"

#include <openvdb/version.h>

#include <array>
#include <cstdint>
#include <span>

namespace splatvol {
namespace {

// Older files have other headers. They are of 2012 or before.
constexpr std::uint32_t oldest_read = 220;
constexpr std::uint32_t first_with_compression_of_grids = 222;  // before, there is a flag for all of them
constexpr std::uint64_t uuid_bytes = 36;

/// Reads numbers one after the other. After the first that lies past the end, all are 0.
class Cursor {
 public:
  explicit Cursor(ByteSource& file) : file_(file) {}

  template <class T>
  T number() {
    std::array<T, 1> value = {};
    if (!holds(sizeof(T)) || !file_.read(offset_, std::as_writable_bytes(std::span(value)))) {
      valid_ = false;
      return 0;
    }
    offset_ += sizeof(T);
    return value[0];
  }

  void skip(std::uint64_t bytes) {
    valid_ = holds(bytes);
    if (valid_) offset_ += bytes;
  }

  /// Skips a length, and that number of bytes.
  void skip_text() { skip(number<std::uint32_t>()); }

  void skip_metadata() {
    const std::uint32_t count = number<std::uint32_t>();
    for (std::uint32_t i = 0; i < count && valid_; ++i) {
      skip_text();  // name
      skip_text();  // type
      skip_text();  // value
    }
  }

  void seek(std::uint64_t offset) {
    valid_ = valid_ && offset <= file_.size();
    if (valid_) offset_ = offset;
  }

  [[nodiscard]] std::uint64_t offset() const { return offset_; }
  [[nodiscard]] bool valid() const { return valid_; }

 private:
  [[nodiscard]] bool holds(std::uint64_t bytes) const { return valid_ && bytes <= file_.size() - offset_; }

  ByteSource& file_;
  std::uint64_t offset_ = 0;
  bool valid_ = true;
};

}  // namespace

Status check_vdb_header(ByteSource& file) {
  Cursor cursor(file);
  cursor.skip(sizeof(std::uint64_t));  // magic
  const std::uint32_t version = cursor.number<std::uint32_t>();
  if (version > openvdb::OPENVDB_FILE_VERSION)
    return fail(ErrorCode::unsupported,
                "{}: file version {} is newer than {}, the newest that this version reads right", file.name(), version,
                openvdb::OPENVDB_FILE_VERSION);
  if (version < oldest_read && cursor.valid())
    return fail(ErrorCode::unsupported, "{}: file version {} is older than {}, the oldest that is read: write it anew",
                file.name(), version, oldest_read);
  const bool grids_have_compression = version >= first_with_compression_of_grids;
  cursor.skip(2 * sizeof(std::uint32_t));  // the library's version
  const bool has_offsets = cursor.number<std::uint8_t>() != 0;
  if (!grids_have_compression) cursor.skip(sizeof(std::uint8_t));
  cursor.skip(uuid_bytes);
  cursor.skip_metadata();
  const std::uint32_t grids = cursor.number<std::uint32_t>();
  for (std::uint32_t i = 0; i < grids && cursor.valid(); ++i) {
    cursor.skip_text();  // name
    cursor.skip_text();  // type
    cursor.skip_text();  // another grid, if this one shares its tree
    const std::uint64_t begin = cursor.number<std::uint64_t>(), bricks = cursor.number<std::uint64_t>(),
                        end = cursor.number<std::uint64_t>();
    if (has_offsets) {
      if (begin < cursor.offset() || begin > bricks || bricks > end) cursor.seek(file.size() + 1);
      cursor.seek(begin);
    }
    if (grids_have_compression) cursor.skip(sizeof(std::uint32_t));
    cursor.skip_metadata();
    cursor.skip_text();       // type of the transform
    if (!has_offsets) break;  // only OpenVDB finds out where the next grid begins
    cursor.seek(end);
  }
  if (cursor.valid()) return {};
  return fail(ErrorCode::invalid_data, "{}: damaged: a part of it ends past the end of the file", file.name());
}

}  // namespace splatvol
