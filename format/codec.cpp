#include "format/codec.h"

#include <xxhash.h>
#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>
#include <array>
#include <memory>
#include <new>

#include "base/interruption.h"
#include "base/sizes.h"

namespace splatvol::format {
namespace {

// The fastest. Level 3 takes longer; levels above it gain less than 2 % on byte planes of floats.
constexpr int compression_level = 1;
constexpr std::uint64_t max_ratio = 1024;  // R7
constexpr std::uint64_t ratio_slack = 64;

// zstd, which is C, returns a null pointer where memory ends.
template <class Context>
Context* not_null(Context* context) {
  if (!context) throw std::bad_alloc();
  return context;
}

// One context for each thread: making one takes longer than compressing a chunk.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(not_null(ZSTD_createCCtx()),
                                                                                  &ZSTD_freeCCtx);
  return context.get();
}

ZSTD_DCtx* decompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(not_null(ZSTD_createDCtx()),
                                                                                  &ZSTD_freeDCtx);
  return context.get();
}

// Shorter blocks are joined: the description of a block's statistics takes some 50 bytes.
constexpr std::size_t least_block_bytes = 256;

// `size`: of the frame, or zstd's error. A lack of memory changes no bytes: it ends the work.
Bytes frame_or_raw(const Bytes& frame, std::size_t size, std::span<const std::byte> raw) {
  if (ZSTD_getErrorCode(size) == ZSTD_error_memory_allocation) throw std::bad_alloc();
  if (ZSTD_isError(size) || size >= raw.size() || raw.size() > max_ratio * size + ratio_slack)
    return Bytes(raw.begin(), raw.end());
  return Bytes(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size));
}

}  // namespace

StreamHash::StreamHash() : state_(XXH3_createState()) {
  if (!state_) throw std::bad_alloc();
  XXH3_64bits_reset(state_);
}
StreamHash::~StreamHash() { XXH3_freeState(state_); }
void StreamHash::add(std::span<const std::byte> part) { XXH3_64bits_update(state_, part.data(), part.size()); }
std::uint64_t StreamHash::value() const { return XXH3_64bits_digest(state_); }

std::uint64_t hash_bytes(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

Bytes pack(std::span<const std::byte> raw) { return pack_blocks(raw, {}); }

Bytes pack_blocks(std::span<const std::byte> raw, std::span<const std::size_t> ends) {
  ZSTD_CCtx* context = compressor();
  ZSTD_CCtx_reset(context, ZSTD_reset_session_and_parameters);
  ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, compression_level);
  ZSTD_CCtx_setPledgedSrcSize(context, raw.size());
  thread_local Bytes packed;  // the result is a copy, which has no spare capacity
  packed.resize(std::max(packed.size(), ZSTD_compressBound(raw.size()) + 16 * (ends.size() + 1)));
  ZSTD_outBuffer out = {packed.data(), packed.size(), 0};
  ZSTD_inBuffer in = {raw.data(), 0, 0};
  for (const std::size_t end : ends) {
    if (std::min(end - in.size, raw.size() - end) < least_block_bytes) continue;
    in.size = end;
    const std::size_t left = ZSTD_compressStream2(context, &out, &in, ZSTD_e_flush);
    if (ZSTD_isError(left)) return frame_or_raw(packed, left, raw);
  }
  in.size = raw.size();
  const std::size_t left = ZSTD_compressStream2(context, &out, &in, ZSTD_e_end);
  return frame_or_raw(packed, ZSTD_isError(left) ? left : out.pos, raw);
}

namespace {

tl::unexpected<Error> fail_damaged(std::string_view what) {
  return fail(ErrorCode::invalid_data, "{}: damaged zstd frame [R7]", what);
}

Status decompress(std::span<const std::byte> packed, std::span<std::byte> raw, std::string_view what) {
  const std::size_t size = ZSTD_decompressDCtx(decompressor(), raw.data(), raw.size(), packed.data(), packed.size());
  if (ZSTD_isError(size) || size != raw.size()) return fail_damaged(what);
  return {};
}

// Memory that a thread keeps, up to the largest chunks of ordinary files.
class Scratch {
 public:
  std::span<std::byte> get(std::size_t size) {
    constexpr std::size_t kept = std::size_t{4} << 20;
    if (size > size_ || size_ > kept) {
      bytes_ = std::make_unique_for_overwrite<std::byte[]>(size);
      size_ = size;
    }
    return {bytes_.get(), size};
  }

 private:
  std::unique_ptr<std::byte[]> bytes_;
  std::size_t size_ = 0;
};

}  // namespace

Status check_ratio(std::uint64_t packed_bytes, std::uint64_t unpacked_bytes, std::string_view what) {
  if (unpacked_bytes < packed_bytes || unpacked_bytes > max_ratio * packed_bytes + ratio_slack)
    return fail(ErrorCode::invalid_data, "{}: {} bytes cannot hold {} [R7]", what, packed_bytes, unpacked_bytes);
  return {};
}

Result<Bytes> unpack(std::span<const std::byte> packed, std::uint64_t unpacked_bytes, std::string_view what) {
  if (packed.size() == unpacked_bytes) return Bytes(packed.begin(), packed.end());
  SPLATVOL_TRY(check_ratio(packed.size(), unpacked_bytes, what));
  SPLATVOL_TRY_ASSIGN(size, as_size(unpacked_bytes, what));
  Bytes raw(size);
  SPLATVOL_TRY(decompress(packed, raw, what));
  return raw;
}

Result<std::span<const std::byte>> unpack_here(std::span<const std::byte> packed, std::uint64_t unpacked_bytes,
                                               std::string_view what) {
  if (packed.size() == unpacked_bytes) return packed;
  SPLATVOL_TRY(check_ratio(packed.size(), unpacked_bytes, what));
  thread_local Scratch scratch;
  SPLATVOL_TRY_ASSIGN(size, as_size(unpacked_bytes, what));
  const std::span<std::byte> raw = scratch.get(size);
  SPLATVOL_TRY(decompress(packed, raw, what));
  return std::span<const std::byte>(raw);
}

// zstd's state, between reads.
struct Unpacker::Frame {
  explicit Frame(std::span<const std::byte> packed)
      : context(not_null(ZSTD_createDCtx()), &ZSTD_freeDCtx), in{packed.data(), packed.size(), 0} {
    ZSTD_DCtx_setParameter(context.get(), ZSTD_d_windowLogMax, window_log);
  }

  // Unpacks up to out.size() bytes. Returns how many; fewer at the frame's end.
  Result<std::size_t> read(std::span<std::byte> out, std::string_view what) {
    ZSTD_outBuffer buffer = {out.data(), out.size(), 0};
    while (buffer.pos < buffer.size && !ended) {
      const std::size_t before = in.pos + buffer.pos;
      const std::size_t left = ZSTD_decompressStream(context.get(), &buffer, &in);
      if (ZSTD_getErrorCode(left) == ZSTD_error_frameParameter_windowTooLarge)
        return fail(ErrorCode::unsupported, "{}: its zstd frame needs a window of more than 8 MiB", what);
      if (ZSTD_getErrorCode(left) == ZSTD_error_memory_allocation) throw std::bad_alloc();
      ended = left == 0;
      if (ZSTD_isError(left) || (!ended && in.pos + buffer.pos == before)) return fail_damaged(what);
    }
    return buffer.pos;
  }

  static constexpr int window_log = 23;
  std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context;
  ZSTD_inBuffer in;
  bool ended = false;
};

Unpacker::Unpacker(std::span<const std::byte> packed, std::uint64_t unpacked_bytes, std::string_view what)
    : packed_(packed), unpacked_bytes_(unpacked_bytes), what_(what) {
  if (packed.size() != unpacked_bytes) frame_ = std::make_unique<Frame>(packed);
}
Unpacker::Unpacker(Unpacker&&) noexcept = default;
Unpacker& Unpacker::operator=(Unpacker&&) noexcept = default;
Unpacker::~Unpacker() = default;

Status Unpacker::read(std::span<std::byte> out) {
  if (out.size() > unpacked_bytes_ - at_) return fail_damaged(what_);
  if (frame_) {
    SPLATVOL_TRY_ASSIGN(count, frame_->read(out, what_));
    if (count < out.size()) return fail_damaged(what_);
  } else {
    std::ranges::copy(packed_.subspan(static_cast<std::size_t>(at_), out.size()), out.begin());
  }
  at_ += out.size();
  return {};
}

Status Unpacker::skip_to(std::uint64_t offset) {
  if (!frame_) at_ = offset;
  std::array<std::byte, 1u << 16> skipped;
  while (at_ < offset) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY(read(
        std::span(skipped).first(static_cast<std::size_t>(std::min<std::uint64_t>(skipped.size(), offset - at_)))));
  }
  return {};
}

Status Unpacker::finish() {
  std::byte more{};
  if (at_ != unpacked_bytes_) return fail_damaged(what_);
  if (!frame_) return {};
  SPLATVOL_TRY_ASSIGN(count, frame_->read({&more, 1}, what_));
  if (count > 0 || !frame_->ended || frame_->in.pos != frame_->in.size) return fail_damaged(what_);
  return {};
}

}  // namespace splatvol::format
