// The bytes of a file of OpenFOAM, plain or packed by gzip.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "base/file.h"

namespace splatvol {

/// Reads a file forwards. A file that is packed by gzip, which its first bytes tell, is unpacked on the way. All
/// functions throw a ReaderError if the file cannot be read, or if its packed bytes are damaged or cut off.
class FoamStream {
 public:
  /// Opens a regular file. `name` begins all messages.
  FoamStream(const std::string& path, std::string name);
  FoamStream(const FoamStream&) = delete;
  FoamStream& operator=(const FoamStream&) = delete;
  ~FoamStream();

  [[nodiscard]] const std::string& name() const { return name_; }

  /// The line of the next byte, if no binary bytes were read before. The first is 1.
  [[nodiscard]] std::uint64_t line() const { return line_; }

  /// The next byte; -1 at the end.
  int peek() { return at_ < end_ || fill(1) ? static_cast<unsigned char>(buffer_[at_]) : -1; }

  /// Takes a byte that peek() has shown.
  void take() {
    if (buffer_[at_] == '\n') ++line_;
    ++at_;
  }

  /// The next bytes without taking them: `count` of them, at most 4096, or fewer at the end.
  std::string_view ahead(std::size_t count);

  /// Takes bytes that ahead() has shown, none of which ends a line.
  void take(std::size_t count) { at_ += count; }

  /// Fills `out` with the next bytes, or takes `count` bytes. Throws if there are fewer.
  void read(std::span<std::byte> out);
  void skip(std::uint64_t count);

  /// How many bytes were taken so far.
  [[nodiscard]] std::uint64_t taken() const { return before_ + at_; }

  /// No more bytes than these can follow. It is the exact number in a plain file.
  [[nodiscard]] std::uint64_t most_left() const;
  [[nodiscard]] bool is_packed() const { return unpacker_ != nullptr; }

  /// Lets the file end after `count` more bytes. Requires that it has so many, if it is plain.
  void end_after(std::uint64_t count);

 private:
  struct Unpacker;

  /// Whether there are `count` unread bytes in the buffer, reading more if it must.
  bool fill(std::size_t count);
  std::size_t read_more(std::span<std::byte> out);
  std::size_t read_plain(std::span<std::byte> out);
  std::size_t unpack(std::span<std::byte> out);

  std::string name_;
  std::unique_ptr<ByteSource> file_;
  std::unique_ptr<Unpacker> unpacker_;  // null: the file is plain
  std::uint64_t offset_ = 0;            // of the next byte of the file that is not read yet
  std::uint64_t before_ = 0;            // bytes taken before buffer_
  std::uint64_t left_;                  // unpacked bytes that may be read into the buffer
  std::string buffer_;
  std::size_t at_ = 0, end_ = 0;  // unread bytes in buffer_
  std::size_t portion_;
  std::uint64_t line_ = 1;
};

}  // namespace splatvol
