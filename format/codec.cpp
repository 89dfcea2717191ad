#include "format/codec.h"

#include <xxhash.h>
#include <zstd.h>

#include <memory>

namespace splatvol::format {
namespace {

// The fastest. Level 3 takes longer; levels above it gain less than 2 % on byte planes of floats.
constexpr int compression_level = 1;
constexpr std::uint64_t max_ratio = 1024;  // R7
constexpr std::uint64_t ratio_slack = 64;

// One context for each thread: making one takes longer than compressing a chunk.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(), &ZSTD_freeCCtx);
  return context.get();
}

ZSTD_DCtx* decompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(), &ZSTD_freeDCtx);
  return context.get();
}

}  // namespace

std::uint64_t hash_bytes(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

Bytes pack(std::span<const std::byte> raw) {
  thread_local Bytes packed;  // the result is a copy, which has no spare capacity
  packed.resize(std::max(packed.size(), ZSTD_compressBound(raw.size())));
  const std::size_t size =
      ZSTD_compressCCtx(compressor(), packed.data(), packed.size(), raw.data(), raw.size(), compression_level);
  if (ZSTD_isError(size) || size >= raw.size() || raw.size() > max_ratio * size + ratio_slack)
    return Bytes(raw.begin(), raw.end());
  return Bytes(packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(size));
}

Result<Bytes> unpack(std::span<const std::byte> packed, std::uint64_t unpacked_bytes, std::string_view what) {
  if (packed.size() == unpacked_bytes) return Bytes(packed.begin(), packed.end());
  if (unpacked_bytes < packed.size() || unpacked_bytes > max_ratio * packed.size() + ratio_slack)
    return fail(ErrorCode::invalid_data, "{}: {} bytes cannot hold {} [R7]", what, packed.size(), unpacked_bytes);
  Bytes raw(unpacked_bytes);
  const std::size_t size = ZSTD_decompressDCtx(decompressor(), raw.data(), raw.size(), packed.data(), packed.size());
  if (ZSTD_isError(size) || size != unpacked_bytes)
    return fail(ErrorCode::invalid_data, "{}: damaged zstd frame [R7]", what);
  return raw;
}

}  // namespace splatvol::format
