#include "builder/sources/openfoam/foam_stream.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "builder/sources/read_text.h"
#include "builder/sources/reader_error.h"

namespace splatvol {
namespace {

constexpr std::size_t first_portion = std::size_t{4} << 10, largest_portion = std::size_t{1} << 20;
constexpr std::uint64_t largest_ratio = 1032;  // of unpacked to packed bytes (zlib's documentation)
constexpr std::uint64_t unlimited = std::numeric_limits<std::uint64_t>::max();

bool is_gzip(std::string_view bytes) { return bytes.starts_with("\x1f\x8b"); }

}  // namespace

struct FoamStream::Unpacker {
  z_stream state{};
  std::vector<std::byte> packed;
  bool at_end = false;  // of a member: another may follow

  Unpacker() : packed(std::size_t{64} << 10) {
    if (inflateInit2(&state, 16 + MAX_WBITS) != Z_OK) throw ReaderError("not enough memory to unpack a file");
  }
  Unpacker(const Unpacker&) = delete;
  Unpacker& operator=(const Unpacker&) = delete;
  ~Unpacker() { inflateEnd(&state); }
};

FoamStream::FoamStream(const std::string& path, std::string name)
    : name_(std::move(name)), left_(unlimited), buffer_(first_portion, '\0'), portion_(first_portion) {
  auto file = open_file(path);
  if (!file) throw ReaderError("{}", file.error().message);
  file_ = std::move(*file);
  std::array<std::byte, 2> start{};
  if (file_->size() >= start.size() && file_->read(0, start) &&
      is_gzip({reinterpret_cast<const char*>(start.data()), start.size()}))
    unpacker_ = std::make_unique<Unpacker>();
  if (ahead(byte_order_mark.size()) == byte_order_mark) take(byte_order_mark.size());
}

FoamStream::~FoamStream() = default;

std::string_view FoamStream::ahead(std::size_t count) {
  fill(count);
  return {buffer_.data() + at_, std::min(count, end_ - at_)};
}

void FoamStream::read(std::span<std::byte> out) {
  const std::size_t buffered = std::min(out.size(), end_ - at_);
  std::memcpy(out.data(), buffer_.data() + at_, buffered);
  at_ += buffered;
  for (out = out.subspan(buffered); !out.empty();) {
    const std::size_t count = read_more(out);
    if (count == 0) throw ReaderError("{}: the file is cut off: it ends within a list", name_);
    before_ += count;
    out = out.subspan(count);
  }
}

void FoamStream::skip(std::uint64_t count) {
  const std::uint64_t buffered = std::min<std::uint64_t>(count, end_ - at_);
  at_ += static_cast<std::size_t>(buffered);
  count -= buffered;
  if (count == 0) return;
  if (count > most_left()) throw ReaderError("{}: the file is cut off: it ends within a list", name_);
  if (!unpacker_) {
    offset_ += count;
    before_ += count;
    left_ -= left_ == unlimited ? 0 : count;
    portion_ = first_portion;  // little may be wanted there
    return;
  }
  while (count > 0) {
    if (!fill(1)) throw ReaderError("{}: the file is cut off: it ends within a list", name_);
    const std::uint64_t taken = std::min<std::uint64_t>(count, end_ - at_);
    at_ += static_cast<std::size_t>(taken);
    count -= taken;
  }
}

std::uint64_t FoamStream::most_left() const {
  const std::uint64_t buffered = end_ - at_, in_file = file_->size() - offset_;
  if (!unpacker_) return buffered + std::min(left_, in_file);
  const std::uint64_t packed = in_file + unpacker_->state.avail_in;
  return buffered + std::min(left_, packed * largest_ratio + (std::uint64_t{1} << 16));
}

void FoamStream::end_after(std::uint64_t count) {
  const std::uint64_t buffered = end_ - at_;
  if (count <= buffered) {
    end_ = at_ + static_cast<std::size_t>(count);
    left_ = 0;
  } else {
    left_ = count - buffered;
  }
}

bool FoamStream::fill(std::size_t count) {
  if (end_ - at_ >= count) return true;
  std::memmove(buffer_.data(), buffer_.data() + at_, end_ - at_);
  end_ -= at_;
  before_ += at_;
  at_ = 0;
  while (end_ < count) {
    buffer_.resize(std::max(buffer_.size(), std::max(portion_, 2 * count)));
    const std::size_t read = read_more(std::as_writable_bytes(std::span(buffer_)).subspan(end_));
    if (read == 0) return false;
    end_ += read;
    portion_ = std::min(2 * portion_, largest_portion);
  }
  return true;
}

/// Reads the next bytes behind those of the buffer; 0: there are none.
std::size_t FoamStream::read_more(std::span<std::byte> out) {
  out = out.first(static_cast<std::size_t>(std::min<std::uint64_t>(out.size(), left_)));
  const std::size_t count = unpacker_ ? unpack(out) : read_plain(out);
  left_ -= left_ == unlimited ? 0 : count;
  return count;
}

std::size_t FoamStream::read_plain(std::span<std::byte> out) {
  out = out.first(static_cast<std::size_t>(std::min<std::uint64_t>(out.size(), file_->size() - offset_)));
  if (out.empty()) return 0;
  if (const Status read = file_->read(offset_, out); !read) throw ReaderError("{}", read.error().message);
  offset_ += out.size();
  return out.size();
}

std::size_t FoamStream::unpack(std::span<std::byte> out) {
  z_stream& state = unpacker_->state;
  state.next_out = reinterpret_cast<Bytef*>(out.data());
  state.avail_out = static_cast<uInt>(std::min<std::size_t>(out.size(), largest_portion));
  const uInt room = state.avail_out;
  while (state.avail_out == room && room > 0) {
    if (state.avail_in == 0) {
      state.next_in = reinterpret_cast<Bytef*>(unpacker_->packed.data());
      state.avail_in = static_cast<uInt>(read_plain(unpacker_->packed));
    }
    if (unpacker_->at_end) {
      // A member is followed by another one, or by padding.
      if (state.avail_in == 0 || *state.next_in != 0x1f) return 0;
      inflateReset(&state);
      unpacker_->at_end = false;
    }
    if (state.avail_in == 0) throw ReaderError("{}: the file is cut off: its packed bytes end early", name_);
    const int result = inflate(&state, Z_NO_FLUSH);
    unpacker_->at_end = result == Z_STREAM_END;
    if (result != Z_OK && result != Z_STREAM_END && result != Z_BUF_ERROR)
      throw ReaderError("{}: its packed bytes are damaged", name_);
  }
  return room - state.avail_out;
}

}  // namespace splatvol
