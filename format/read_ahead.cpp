#include "format/read_ahead.h"

#include <algorithm>
#include <mutex>
#include <utility>

#include "format/run_tasks.h"

namespace splatvol::format {
namespace {

constexpr std::uint64_t bytes_of_request = std::uint64_t{256} << 10;
constexpr std::size_t free_requests = 2;
constexpr std::size_t requests_at_once = 6;  // as browsers have to a server

}  // namespace

std::vector<ByteRange> join_ranges(std::vector<ByteRange> ranges) {
  std::erase_if(ranges, [](const ByteRange& range) { return range.begin >= range.end; });
  std::ranges::sort(ranges, {}, &ByteRange::begin);
  // Joins those between which there is a gap of at most so many bytes.
  const auto join = [&](std::uint64_t gap) {
    std::vector<ByteRange> joined;
    for (const ByteRange& range : ranges)
      if (!joined.empty() && range.begin <= joined.back().end + gap)
        joined.back().end = std::max(joined.back().end, range.end);
      else
        joined.push_back(range);
    return joined;
  };
  ranges = join(0);
  std::vector<std::uint64_t> gaps;
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    bytes += ranges[i].end - ranges[i].begin;
    if (i > 0) gaps.push_back(ranges[i].begin - ranges[i - 1].end);
  }
  std::ranges::sort(gaps);
  std::size_t closed = 0;
  while (closed < gaps.size() && ranges.size() - closed > free_requests + bytes / bytes_of_request)
    bytes += gaps[closed++];
  return closed == 0 ? ranges : join(gaps[closed - 1]);
}

Status CountedSource::read(std::uint64_t offset, std::span<std::byte> out) {
  if (holds_any_ && take_held(offset, out)) return {};
  SPLATVOL_TRY(source_->read(offset, out));
  bytes_read_ += out.size();
  return {};
}

bool CountedSource::take_held(std::uint64_t offset, std::span<std::byte> out) const {
  const std::shared_lock lock(mutex_);
  for (const Held* held : held_) {
    if (offset < held->begin || offset - held->begin > held->bytes.size() ||
        out.size() > held->bytes.size() - (offset - held->begin))
      continue;
    std::ranges::copy(std::span(held->bytes).subspan(offset - held->begin, out.size()), out.begin());
    return true;
  }
  return false;
}

Result<std::shared_ptr<const BytesAhead>> BytesAhead::read(std::shared_ptr<CountedSource> source,
                                                           std::span<const ByteRange> ranges) {
  std::shared_ptr<BytesAhead> ahead(new BytesAhead(std::move(source)));
  for (const ByteRange& range : ranges) ahead->held_.push_back({range.begin, Bytes(range.end - range.begin)});
  CountedSource& from = *ahead->source_;
  SPLATVOL_TRY(run_tasks(ranges.size(), requests_at_once, [&](std::size_t i, std::size_t /*thread*/) {
    return from.read(ahead->held_[i].begin, ahead->held_[i].bytes);
  }));
  const std::unique_lock lock(from.mutex_);
  for (const CountedSource::Held& held : ahead->held_) from.held_.push_back(&held);
  from.holds_any_ = !from.held_.empty();
  return ahead;
}

BytesAhead::~BytesAhead() {
  const std::unique_lock lock(source_->mutex_);
  std::erase_if(source_->held_, [&](const CountedSource::Held* one) {
    return std::ranges::any_of(held_, [&](const CountedSource::Held& own) { return &own == one; });
  });
  source_->holds_any_ = !source_->held_.empty();
}

}  // namespace splatvol::format
