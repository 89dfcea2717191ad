#include "builder/sources/vtk/compression.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint64_t largest_compressed_block = std::uint64_t{1} << 30;  // writers use 32 KiB

/// Decodes up to the first character that is not base64's.
std::string decode_base64(std::string_view text) {
  constexpr std::string_view alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    const std::size_t value = alphabet.find(c);
    if (value == std::string_view::npos) break;
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes += static_cast<char>(bits >> count & 0xff);
  }
  return bytes;
}

/// Reads the first `count` numbers of a header, or fewer if it is cut off.
Result<std::vector<std::uint64_t>> read_numbers(ByteSource& file, CompressionLayout layout, std::uint64_t offset,
                                                bool base64, std::uint64_t count) {
  const std::size_t word = layout.wide ? 8 : 4;
  const std::uint64_t bytes = count * word;
  SPLATVOL_TRY_ASSIGN(raw, read_text(file, offset, base64 ? (bytes + 2) / 3 * 4 : bytes));
  if (base64) raw = decode_base64(raw);
  std::vector<std::uint64_t> numbers(std::min<std::size_t>(count, raw.size() / word));
  for (std::size_t i = 0; i < numbers.size(); ++i)
    numbers[i] = number_in(std::string_view(raw).substr(i * word, word), layout.big_endian);
  return numbers;
}

tl::unexpected<Error> fail_cut(const ByteSource& file, std::uint64_t offset) {
  return fail(ErrorCode::invalid_data, "{}: the file is cut off: it ends within the array at byte {}", file.name(),
              offset);
}

/// Fails if fewer than `bytes` bytes follow `offset`.
Status check_end(const ByteSource& file, std::uint64_t offset, double bytes) {
  if (offset <= file.size() && bytes <= static_cast<double>(file.size() - offset)) return {};
  return fail_cut(file, offset);
}

}  // namespace

Result<double> check_compression_header(ByteSource& file, CompressionLayout layout, std::uint64_t offset, bool base64) {
  const auto damaged = [&] {
    return fail(ErrorCode::invalid_data, "{}: the header of the compressed array at byte {} is damaged", file.name(),
                offset);
  };
  SPLATVOL_TRY_ASSIGN(sizes, read_numbers(file, layout, offset, base64, 3));
  if (sizes.size() < 3) return damaged();
  const std::uint64_t compressed_blocks = sizes[0], unpacked_bytes = sizes[1], last_bytes = sizes[2];
  if (compressed_blocks == 0 && last_bytes > 0) return damaged();
  if (compressed_blocks == 0) return 0.0;
  if (compressed_blocks > file.size() || unpacked_bytes == 0 || unpacked_bytes > largest_compressed_block ||
      last_bytes > unpacked_bytes)
    return damaged();

  SPLATVOL_TRY_ASSIGN(numbers, read_numbers(file, layout, offset, base64, 3 + compressed_blocks));
  const auto too_large = [&](std::uint64_t packed_bytes) { return packed_bytes > file.size(); };
  const bool whole =
      numbers.size() == 3 + compressed_blocks && std::none_of(numbers.begin() + 3, numbers.end(), too_large);
  if (!whole) return damaged();

  // Both sums fit: there are no more compressed blocks than bytes in the file, and none is larger than the file.
  const auto encoded = [&](double bytes) { return base64 ? std::ceil(bytes / 3) * 4 : bytes; };
  const double header = static_cast<double>(numbers.size()) * (layout.wide ? 8 : 4);
  const double packed = std::accumulate(numbers.begin() + 3, numbers.end(), 0.0);
  SPLATVOL_TRY(check_end(file, offset, encoded(header) + encoded(packed)));
  const std::uint64_t missing = last_bytes == 0 ? 0 : unpacked_bytes - last_bytes;
  return static_cast<double>(compressed_blocks) * static_cast<double>(unpacked_bytes) - static_cast<double>(missing);
}

Result<double> check_uncompressed_array(ByteSource& file, CompressionLayout layout, std::uint64_t offset, bool base64) {
  const std::size_t word = layout.wide ? 8 : 4;
  SPLATVOL_TRY_ASSIGN(numbers, read_numbers(file, layout, offset, base64, 1));
  if (numbers.empty()) return fail_cut(file, offset);
  const auto bytes = static_cast<double>(numbers[0]);
  double all = static_cast<double>(word) + bytes;
  if (base64) {
    // Some writers encode the header and the data each by itself, others both together.
    SPLATVOL_TRY_ASSIGN(header, read_text(file, offset, (word + 2) / 3 * 4));
    const bool apart = header.ends_with('=');
    all = apart ? static_cast<double>(header.size()) + std::ceil(bytes / 3) * 4 : std::ceil(all / 3) * 4;
  }
  SPLATVOL_TRY(check_end(file, offset, all));
  return bytes;
}

}  // namespace splatvol
