// Values one after another as bytes, for temporary files and for messages between processes of one build.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <tuple>
#include <type_traits>
#include <vector>

namespace splatvol {

/// Appends values to bytes.
class ByteWriter {
 public:
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void put(const T& value) { append(std::as_bytes(std::span(&value, 1))); }

  /// The number of items, then the items.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void put(const std::vector<T>& items) {
    put(std::uint64_t{items.size()});
    append(std::as_bytes(std::span(items)));
  }

  /// Each of several members, which std::tie names.
  template <class... Members>
  void put_members(const std::tuple<Members&...>& members) {
    std::apply([this](const auto&... each) { (this->put(each), ...); }, members);
  }

  void append(std::span<const std::byte> more) { bytes_.insert(bytes_.end(), more.begin(), more.end()); }

  [[nodiscard]] const std::vector<std::byte>& bytes() const { return bytes_; }
  void clear() { bytes_.clear(); }

 private:
  std::vector<std::byte> bytes_;
};

/// Reads what a ByteWriter wrote, in the same order. Requires that all of it is there.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  requires std::is_trivially_copyable_v<T>
  void get(T& value) { copy_to(std::as_writable_bytes(std::span(&value, 1))); }

  template <class T>
  requires std::is_trivially_copyable_v<T>
  void get(std::vector<T>& items) {
    std::uint64_t count = 0;
    get(count);
    items.resize(count);
    copy_to(std::as_writable_bytes(std::span(items)));
  }

  template <class... Members>
  void get_members(const std::tuple<Members&...>& members) {
    std::apply([this](auto&... each) { (this->get(each), ...); }, members);
  }

  /// Fills in items whose number the reader knows.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void fill(std::span<T> items) { copy_to(std::as_writable_bytes(items)); }

  /// The next bytes, which stay where they are.
  [[nodiscard]] std::span<const std::byte> take(std::size_t count) {
    const std::span<const std::byte> taken = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return taken;
  }

  [[nodiscard]] std::span<const std::byte> rest() const { return bytes_; }

  [[nodiscard]] bool at_end() const { return bytes_.empty(); }

 private:
  void copy_to(std::span<std::byte> out) {
    const std::span<const std::byte> from = take(out.size());
    if (!out.empty()) std::memcpy(out.data(), from.data(), out.size());
  }

  std::span<const std::byte> bytes_;
};

}  // namespace splatvol
