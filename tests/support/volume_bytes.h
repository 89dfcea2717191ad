// Files in memory, as bytes.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "base/file.h"
#include "format/volume.h"
#include "tests/support/memory_source.h"
#include "tests/support/replaced.h"

namespace splatvol::test {

inline format::Bytes bytes_of(const std::string& text) {
  const auto raw = std::as_bytes(std::span(text));
  return {raw.begin(), raw.end()};
}

inline std::string text_of(const format::Bytes& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Returns a change of bytes that are a text: `to` comes instead of the first `from`.
inline std::function<void(format::Bytes&)> replacing(const std::string& from, const std::string& to) {
  return [=](format::Bytes& bytes) { bytes = bytes_of(replaced(text_of(bytes), from, to)); };
}

/// Opens a file, at all of its steps, and checks all of it. Returns the message of the first error, or an empty text.
inline std::string error_of(std::unique_ptr<ByteSource> file, std::size_t threads = 1) {
  const auto volume = format::Volume::open(std::move(file));
  if (!volume) return volume.error().message;
  const Status verified = (*volume)->verify([](double) {}, threads);
  return verified ? "" : verified.error().message;
}

inline std::string error_of(const format::Bytes& bytes, std::size_t threads = 1) {
  return error_of(memory_source(bytes, "test.svol"), threads);
}

}  // namespace splatvol::test
