// Numbers, texts and arrays between two processes.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// A type with a function members_of(), which ties the members that are sent.
template <class T>
concept HasMembers = requires(T& value) {
  members_of(value);
};

/// One end of a socket between two processes of one machine and one build. What it sends has no types: both sides name
/// the same ones in the same order. After a failure nothing more can be sent or received. Not thread-safe.
class Channel {
 public:
  /// Called some times a second while something is awaited, arrives, or is not taken. A failure ends the wait.
  using Waiting = std::function<Status()>;

  /// Takes the descriptor. `most_bytes`: arrays that claim to be larger are refused.
  explicit Channel(int descriptor, std::uint64_t most_bytes, Waiting waiting = {})
      : descriptor_(descriptor), most_bytes_(most_bytes), waiting_(std::move(waiting)) {}
  ~Channel();
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  /// Sends bytes. They may wait for the next flush().
  [[nodiscard]] Status send(std::span<const std::byte> bytes);
  [[nodiscard]] Status flush();

  /// Receives bytes. Fails if the other process has ended.
  [[nodiscard]] Status receive(std::span<std::byte> bytes);

  /// Bytes that have come so far.
  [[nodiscard]] std::uint64_t received() const { return received_; }

  template <class T>
  requires std::is_trivially_copyable_v<T>
  [[nodiscard]] Status put(const T& value) { return send(std::as_bytes(std::span(&value, 1))); }
  [[nodiscard]] Status put(const std::string& text);
  template <class T>
  [[nodiscard]] Status put(const std::optional<T>& value) {
    SPLATVOL_TRY(put(value.has_value()));
    return value ? put(*value) : Status{};
  }
  template <class T>
  [[nodiscard]] Status put(const std::vector<T>& values) {
    SPLATVOL_TRY(put(std::uint64_t{values.size()}));
    if constexpr (std::is_trivially_copyable_v<T>) return send(std::as_bytes(std::span(values)));
    for (const T& value : values) SPLATVOL_TRY(put(value));
    return {};
  }
  template <class Key, class T>
  [[nodiscard]] Status put(const std::map<Key, T>& values) {
    SPLATVOL_TRY(put(std::uint64_t{values.size()}));
    for (const auto& [key, value] : values) SPLATVOL_TRY(put_all(key, value));
    return {};
  }
  template <HasMembers T>
  [[nodiscard]] Status put(const T& value) {
    return std::apply([&](const auto&... members) { return put_all(members...); }, members_of(value));
  }
  template <class... Values>
  [[nodiscard]] Status put_all(const Values&... values) {
    Status status;
    (void)((status = put(values)) && ...);
    return status;
  }

  template <class T>
  requires std::is_trivially_copyable_v<T>
  [[nodiscard]] Status get(T& value) { return receive(std::as_writable_bytes(std::span(&value, 1))); }
  [[nodiscard]] Status get(bool& value);
  [[nodiscard]] Status get(std::string& text);
  /// Fails if the text has more bytes.
  [[nodiscard]] Status get(std::string& text, std::uint64_t most_bytes);
  template <class T>
  [[nodiscard]] Status get(std::optional<T>& value) {
    bool has_value = false;
    SPLATVOL_TRY(get(has_value));
    if (!has_value) value.reset();
    return has_value ? get(value.emplace()) : Status{};
  }
  template <class T>
  [[nodiscard]] Status get(std::vector<T>& values) {
    SPLATVOL_TRY_ASSIGN(count, get_count(sizeof(T)));
    if constexpr (std::is_trivially_copyable_v<T>) return get_elements(values, count);
    values.clear();
    for (std::size_t i = 0; i < count; ++i) SPLATVOL_TRY(get(values.emplace_back()));
    return {};
  }
  template <class Key, class T>
  [[nodiscard]] Status get(std::map<Key, T>& values) {
    SPLATVOL_TRY_ASSIGN(count, get_count(sizeof(Key) + sizeof(T)));
    for (std::size_t i = 0; i < count; ++i) {
      Key key{};
      SPLATVOL_TRY(get(key));
      SPLATVOL_TRY(get(values[key]));
    }
    return {};
  }
  template <HasMembers T>
  [[nodiscard]] Status get(T& value) {
    return std::apply([&](auto&... members) { return get_all(members...); }, members_of(value));
  }
  template <class... Values>
  [[nodiscard]] Status get_all(Values&... values) {
    Status status;
    (void)((status = get(values)) && ...);
    return status;
  }

 private:
  [[nodiscard]] Result<std::size_t> get_count(std::size_t element_bytes);

  /// Returns the size that an array of `count` elements grows to when `arrived` of them are there.
  [[nodiscard]] static std::size_t next_size(std::size_t count, std::size_t arrived, std::size_t element_bytes);

  /// Receives elements. An announced count takes no memory before they arrive.
  template <class Elements>
  [[nodiscard]] Status get_elements(Elements& elements, std::size_t count) {
    elements.clear();
    while (elements.size() < count) {
      const std::size_t arrived = elements.size();
      elements.resize(next_size(count, arrived, sizeof(elements[0])));
      SPLATVOL_TRY(receive(std::as_writable_bytes(std::span(elements).subspan(arrived))));
    }
    return {};
  }

  /// Waits until bytes can be received (POLLIN) or sent (POLLOUT).
  [[nodiscard]] Status wait(short event);
  [[nodiscard]] Status send_now(std::span<const std::byte> bytes);

  int descriptor_;
  std::uint64_t most_bytes_;
  Waiting waiting_;
  std::chrono::steady_clock::time_point next_look_;  // when `waiting_` is called next
  std::vector<std::byte> unsent_;
  std::uint64_t received_ = 0;
};

}  // namespace splatvol
