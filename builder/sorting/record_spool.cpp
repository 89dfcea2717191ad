#include "builder/sorting/record_spool.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace splatvol {
namespace {

constexpr std::size_t most_packet_bytes = std::size_t{1} << 17;

}  // namespace

RecordSpool::RecordSpool(std::size_t record_bytes, std::size_t memory, std::string folder)
    : record_bytes_(record_bytes),
      packet_records_(std::max<std::size_t>(std::min(memory / 8, most_packet_bytes) / record_bytes, 1)),
      packet_bytes_(packet_bound(packet_records_, record_bytes)),
      capacity_(std::max((memory - std::min(memory, 2 * packet_bytes_)) / record_bytes, packet_records_)),
      folder_(std::move(folder)) {}

Status RecordSpool::append(std::span<const std::byte> records) {
  // An unused spool takes no memory.
  if (!memory_ && !records.empty()) {
    const std::size_t bytes = 2 * packet_bytes_ + capacity_ * record_bytes_;
    memory_ = std::make_unique_for_overwrite<std::byte[]>(bytes);
    const std::span<std::byte> all(memory_.get(), bytes);
    packed_ = all.first(packet_bytes_);
    unpacked_ = all.subspan(packet_bytes_, packet_bytes_);
    records_ = all.subspan(2 * packet_bytes_);
  }
  while (!records.empty()) {
    if (filled_ == capacity_) SPLATVOL_TRY(spill());
    const std::span<std::byte> room = records_.subspan(filled_ * record_bytes_);
    const std::size_t bytes = std::min(room.size(), records.size());
    std::memcpy(room.data(), records.data(), bytes);
    filled_ += bytes / record_bytes_;
    count_ += bytes / record_bytes_;
    records = records.subspan(bytes);
  }
  return {};
}

Status RecordSpool::spill() {
  if (!file_) SPLATVOL_TRY_SET(file_, TempFile::create(folder_));
  for (std::size_t begin = 0; begin < filled_; begin += packet_records_) {
    const auto locate = [&](std::size_t first, std::span<const std::byte*> located) {
      for (std::size_t i = 0; i < located.size(); ++i)
        located[i] = records_.data() + (begin + first + i) * record_bytes_;
    };
    const std::size_t bytes = pack_records(std::min(packet_records_, filled_ - begin), locate, record_bytes_, packed_);
    SPLATVOL_TRY(file_->append(packed_.first(bytes)));
  }
  filled_ = 0;
  return {};
}

Result<std::span<const std::byte>> RecordSpool::next() {
  if (file_) {
    if (!reader_) reader_.emplace(*file_, 0, file_->size(), record_bytes_, packed_);
    SPLATVOL_TRY_ASSIGN(count, reader_->next(unpacked_));
    if (count > 0) return unpacked_.first(count * record_bytes_);
  }
  return records_.first(std::exchange(filled_, 0) * record_bytes_);
}

}  // namespace splatvol
