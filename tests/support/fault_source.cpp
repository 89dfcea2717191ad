#include "tests/support/fault_source.h"

#include <algorithm>

#include "base/interruption.h"

namespace splatvol::test {

void Faults::fail_read(std::uint64_t number) {
  const std::scoped_lock lock(mutex_);
  failing_read_ = number;
}

void Faults::fail_range(std::uint64_t from, std::uint64_t to) {
  const std::scoped_lock lock(mutex_);
  failing_.emplace_back(from, to);
}

void Faults::corrupt_range(std::uint64_t from, std::uint64_t to) {
  const std::scoped_lock lock(mutex_);
  corrupt_.emplace_back(from, to);
}

void Faults::clear() {
  const std::scoped_lock lock(mutex_);
  failing_read_.reset();
  failing_.clear();
  corrupt_.clear();
}

void Faults::hold() {
  const std::scoped_lock lock(mutex_);
  holding_ = true;
}

void Faults::release() {
  const std::scoped_lock lock(mutex_);
  holding_ = false;
  changed_.notify_all();
}

void Faults::wait_for_held(std::size_t reads) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return held_ >= reads; });
}

void Faults::replace(std::unique_ptr<ByteSource> content) {
  const std::scoped_lock lock(mutex_);
  content_ = std::move(content);
}

std::size_t Faults::held() const {
  const std::scoped_lock lock(mutex_);
  return held_;
}

std::uint64_t Faults::reads() const {
  const std::scoped_lock lock(mutex_);
  return ranges_.size();
}

std::ptrdiff_t Faults::reads_of(std::uint64_t from, std::uint64_t to) const {
  const std::scoped_lock lock(mutex_);
  return std::ranges::count_if(ranges_, [&](const auto& range) { return range.first < to && from < range.second; });
}

std::uint64_t Faults::bytes() const {
  const std::scoped_lock lock(mutex_);
  return bytes_;
}

Status Faults::read(std::uint64_t offset, std::span<std::byte> out) {
  std::unique_lock lock(mutex_);
  const std::uint64_t number = ranges_.size();
  bytes_ += out.size();
  const std::uint64_t end = offset + out.size();
  ranges_.emplace_back(offset, end);
  ++held_;
  changed_.notify_all();
  while (holding_ && !is_interrupted()) changed_.wait_for(lock, interruption_delay);
  --held_;
  if (is_interrupted()) return fail(ErrorCode::io, "{}: interrupted", content_->name());

  const auto touches = [&](const auto& range) { return range.first < end && offset < range.second; };
  if (failing_read_ == number || std::ranges::any_of(failing_, touches))
    return fail(ErrorCode::io, "{}: read {} fails, as the test wants", content_->name(), number);
  const std::shared_ptr<ByteSource> content = content_;
  const Ranges corrupt = corrupt_;
  lock.unlock();

  SPLATVOL_TRY(content->read(offset, out));
  for (const auto& [from, to] : corrupt)
    for (std::uint64_t at = std::max(from, offset); at < std::min(to, end); ++at) out[at - offset] ^= std::byte{0xff};
  return {};
}

FaultSource::FaultSource(std::shared_ptr<Faults> faults)
    : faults_(std::move(faults)), size_(faults_->content_->size()), name_(faults_->content_->name()) {}

}  // namespace splatvol::test
