#include "builder/sources/vdb_header.h"

#include <openvdb/version.h>

#include <array>
#include <cstdint>
#include <span>

namespace splatvol {
namespace {

constexpr std::uint32_t oldest_checked = 222;
constexpr std::uint64_t uuid_bytes = 36;

// Numbers and lengths one after the other. After the first that is not there, all are 0.
class Cursor {
 public:
  explicit Cursor(ByteSource& file) : file_(file) {}

  template <class T>
  T number() {
    std::array<T, 1> value = {};
    if (!holds(sizeof(T)) || !file_.read(at_, std::as_writable_bytes(std::span(value)))) {
      valid_ = false;
      return 0;
    }
    at_ += sizeof(T);
    return value[0];
  }

  void skip(std::uint64_t bytes) {
    valid_ = holds(bytes);
    if (valid_) at_ += bytes;
  }

  /// A length, and so many bytes.
  void skip_text() { skip(number<std::uint32_t>()); }

  void skip_metadata() {
    const std::uint32_t count = number<std::uint32_t>();
    for (std::uint32_t i = 0; i < count && valid_; ++i) {
      skip_text();  // name
      skip_text();  // type
      skip_text();  // value
    }
  }

  void seek(std::uint64_t to) {
    valid_ = valid_ && to <= file_.size();
    if (valid_) at_ = to;
  }

  [[nodiscard]] std::uint64_t position() const { return at_; }
  [[nodiscard]] bool valid() const { return valid_; }

 private:
  [[nodiscard]] bool holds(std::uint64_t bytes) const { return valid_ && bytes <= file_.size() - at_; }

  ByteSource& file_;
  std::uint64_t at_ = 0;
  bool valid_ = true;
};

}  // namespace

Status check_vdb_header(ByteSource& file) {
  Cursor at(file);
  at.skip(sizeof(std::uint64_t));  // magic
  const std::uint32_t version = at.number<std::uint32_t>();
  if (version > openvdb::OPENVDB_FILE_VERSION)
    return fail(ErrorCode::unsupported,
                "{}: file version {} is newer than {}, the newest that this version reads right", file.name(), version,
                openvdb::OPENVDB_FILE_VERSION);
  if (version < oldest_checked && at.valid()) return {};
  at.skip(2 * sizeof(std::uint32_t));  // the library's version
  const bool has_offsets = at.number<std::uint8_t>() != 0;
  at.skip(uuid_bytes);
  at.skip_metadata();
  const std::uint32_t grids = at.number<std::uint32_t>();
  for (std::uint32_t i = 0; i < grids && has_offsets && at.valid(); ++i) {
    at.skip_text();  // name
    at.skip_text();  // type
    at.skip_text();  // another grid whose tree this one shares
    const std::uint64_t begin = at.number<std::uint64_t>(), blocks = at.number<std::uint64_t>(),
                        end = at.number<std::uint64_t>();
    if (begin < at.position() || begin > blocks || blocks > end) at.seek(file.size() + 1);
    at.seek(begin);
    at.skip(sizeof(std::uint32_t));  // compression
    at.skip_metadata();
    at.seek(end);
  }
  if (at.valid()) return {};
  return fail(ErrorCode::invalid_data, "{}: damaged: a part of it ends past the end of the file", file.name());
}

}  // namespace splatvol
