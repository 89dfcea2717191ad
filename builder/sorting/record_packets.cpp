#include "builder/sorting/record_packets.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

namespace splatvol {
namespace {

struct PacketHeader {
  std::uint32_t bytes;  // of the packet, header included
  std::uint32_t records;
  std::uint64_t hash;  // XXH3-64 of what follows: a bad disk must not decide where numbers go in memory
};
static_assert(sizeof(PacketHeader) == 16);

constexpr unsigned whole_word = 32;  // the width that marks a column of unpacked numbers

// The bytes that `count` differences of `width` bits take.
std::size_t packed_bytes(std::size_t count, unsigned width) { return (count * width + 7) / 8; }

template <class T>
T load(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  return value;
}

template <class T>
std::byte* store(std::byte* to, const T& value) {
  std::memcpy(to, &value, sizeof(T));
  return to + sizeof(T);
}

// Writes numbers bit by bit. Touches up to 8 bytes behind the last.
class BitWriter {
 public:
  static constexpr unsigned most_bits = 56;  // in one call

  explicit BitWriter(std::byte* out) : out_(out) {}
  void put(std::uint64_t value, unsigned width) {
    bits_ |= value << used_;
    used_ += width;
    store(out_, bits_);
    out_ += used_ / 8;
    bits_ >>= used_ & ~7u;
    used_ %= 8;
  }

 private:
  std::byte* out_;
  std::uint64_t bits_ = 0;
  unsigned used_ = 0;  // of bits_; below 8 between calls
};

// Packs a column: its width, its minimum unless the numbers stay unpacked, its numbers.
std::byte* pack_column(std::span<const std::uint32_t> column, std::byte* out) {
  std::uint32_t least = column[0], largest = column[0];
  for (const std::uint32_t value : column) {
    least = std::min(least, value);
    largest = std::max(largest, value);
  }
  const auto width = static_cast<unsigned>(std::bit_width(largest - least));
  if (sizeof least + packed_bytes(column.size(), width) >= column.size_bytes()) {
    out = store(out, static_cast<std::uint8_t>(whole_word));
    std::memcpy(out, column.data(), column.size_bytes());
    return out + column.size_bytes();
  }
  out = store(out, static_cast<std::uint8_t>(width));
  out = store(out, least);
  // Two numbers at a time: half as many operations wait for one another.
  BitWriter writer(out);
  std::size_t i = 0;
  if (2 * width <= BitWriter::most_bits)
    for (; i + 1 < column.size(); i += 2)
      writer.put((column[i] - least) | std::uint64_t{column[i + 1] - least} << width, 2 * width);
  for (; i < column.size(); ++i) writer.put(column[i] - least, width);
  return out + packed_bytes(column.size(), width);
}

// Unpacks a column: the low `bytes` bytes of each number, `stride` bytes apart from `out` on.
template <std::size_t bytes>
const std::byte* unpack_column(const std::byte* in, std::size_t count, std::byte* out, std::size_t stride) {
  const auto width = load<std::uint8_t>(in++);
  if (width == whole_word) {
    for (std::size_t i = 0; i < count; ++i) std::memcpy(out + i * stride, in + i * sizeof(std::uint32_t), bytes);
    return in + count * sizeof(std::uint32_t);
  }
  const auto least = load<std::uint32_t>(in);
  in += sizeof least;
  const std::uint64_t mask = (std::uint64_t{1} << width) - 1;
  for (std::size_t i = 0, bit = 0; i < count; ++i, bit += width) {
    const auto value = static_cast<std::uint32_t>(least + (load<std::uint64_t>(in + bit / 8) >> bit % 8 & mask));
    std::memcpy(out + i * stride, &value, bytes);
  }
  return in + packed_bytes(count, width);
}

// Columns gathered at a time. Records lie anywhere, and each cache line of a record should be fetched once.
constexpr std::size_t columns_at_once = 16;

std::byte* pack_group(std::span<const std::byte* const> records, std::size_t record_bytes, std::byte* out) {
  std::array<std::array<std::uint32_t, packed_group>, columns_at_once> columns;
  for (std::size_t first = 0; first < record_bytes; first += 4 * columns_at_once) {
    const std::size_t bytes = std::min(record_bytes - first, 4 * columns_at_once), whole = bytes / 4, rest = bytes % 4;
    for (std::size_t i = 0; i < records.size(); ++i) {
      const std::byte* record = records[i] + first;
      for (std::size_t c = 0; c < whole; ++c) columns[c][i] = load<std::uint32_t>(record + 4 * c);
      if (rest > 0) {
        columns[whole][i] = 0;
        std::memcpy(&columns[whole][i], record + 4 * whole, rest);
      }
    }
    for (std::size_t c = 0; c < (bytes + 3) / 4; ++c)
      out = pack_column(std::span(columns[c]).first(records.size()), out);
  }
  return out;
}

const std::byte* unpack_group(const std::byte* in, std::size_t count, std::size_t record_bytes, std::byte* out) {
  const std::size_t whole = record_bytes / 4 * 4;
  for (std::size_t offset = 0; offset < whole; offset += 4)
    in = unpack_column<4>(in, count, out + offset, record_bytes);
  switch (record_bytes - whole) {
    case 1:
      return unpack_column<1>(in, count, out + whole, record_bytes);
    case 2:
      return unpack_column<2>(in, count, out + whole, record_bytes);
    case 3:
      return unpack_column<3>(in, count, out + whole, record_bytes);
    default:
      return in;
  }
}

}  // namespace

std::size_t pack_records(std::size_t count, const LocateRecords& locate, std::size_t record_bytes,
                         std::span<std::byte> out) {
  std::byte* at = out.data() + sizeof(PacketHeader);
  for (std::size_t begin = 0; begin < count; begin += packed_group) {
    std::array<const std::byte*, packed_group> located;
    const auto group = std::span(located).first(std::min(packed_group, count - begin));
    locate(begin, group);
    at = pack_group(group, record_bytes, at);
  }
  const auto bytes = static_cast<std::size_t>(at - out.data());
  const std::uint64_t hash = XXH3_64bits(out.data() + sizeof(PacketHeader), bytes - sizeof(PacketHeader));
  store(out.data(), PacketHeader{static_cast<std::uint32_t>(bytes), static_cast<std::uint32_t>(count), hash});
  return bytes;
}

Result<std::size_t> PacketReader::next(std::span<std::byte> out) {
  const auto has_packet = [&] {
    return unread_.size() >= sizeof(PacketHeader) && unread_.size() >= load<PacketHeader>(unread_.data()).bytes;
  };
  if (!has_packet()) SPLATVOL_TRY(refill());
  if (unread_.empty()) return std::size_t{0};
  if (!has_packet()) return fail_changed_temporary();
  const auto header = load<PacketHeader>(unread_.data());
  if (header.bytes < sizeof header || header.records * record_bytes_ > out.size() ||
      XXH3_64bits(unread_.data() + sizeof header, header.bytes - sizeof header) != header.hash)
    return fail_changed_temporary();
  const std::byte* in = unread_.data() + sizeof header;
  for (std::size_t begin = 0; begin < header.records; begin += packed_group)
    in = unpack_group(in, std::min(packed_group, header.records - begin), record_bytes_,
                      out.data() + begin * record_bytes_);
  unread_ = unread_.subspan(header.bytes);
  return std::size_t{header.records};
}

Status PacketReader::refill() {
  constexpr std::size_t slack = 8;
  constexpr std::uint64_t page = 4096;  // smaller parts of the file cannot be given back
  if (!unread_.empty()) std::memmove(buffer_.data(), unread_.data(), unread_.size());
  const std::size_t bytes = std::min<std::uint64_t>(buffer_.size() - slack - unread_.size(), end_ - next_);
  SPLATVOL_TRY(file_->read(next_, buffer_.subspan(unread_.size(), bytes)));
  unread_ = buffer_.first(unread_.size() + bytes);
  next_ += bytes;
  const std::uint64_t from = (released_ + page - 1) / page * page, to = next_ / page * page;
  if (from < to && !keep_) {
    file_->release(from, to - from);
    released_ = to;
  }
  return {};
}

}  // namespace splatvol
