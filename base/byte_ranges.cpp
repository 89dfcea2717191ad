#include "base/byte_ranges.h"

#include <algorithm>
#include <iterator>
#include <mutex>
#include <utility>

#include "base/run_tasks.h"

namespace splatvol {
namespace {

constexpr std::size_t requests_at_once = 6;  // as browsers have to a server

// A request of one range costs so many bytes. So many requests cost nothing, as they are under way together.
constexpr std::uint64_t bytes_of_request = std::uint64_t{256} << 10;
constexpr std::size_t free_requests = 2;

}  // namespace

std::vector<ByteRange> join_ranges(std::vector<ByteRange> ranges, std::uint64_t gap) {
  std::erase_if(ranges, [](const ByteRange& range) { return range.begin >= range.end; });
  std::ranges::sort(ranges, {}, &ByteRange::begin);
  std::vector<ByteRange> joined;
  for (const ByteRange& range : ranges)
    if (!joined.empty() && (range.begin <= joined.back().end || range.begin - joined.back().end <= gap))
      joined.back().end = std::max(joined.back().end, range.end);
    else
      joined.push_back(range);
  return joined;
}

std::vector<ByteRange> join_to_few(std::vector<ByteRange> ranges) {
  ranges = join_ranges(std::move(ranges), 0);
  std::vector<std::uint64_t> gaps;
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    bytes += ranges[i].end - ranges[i].begin;
    if (i > 0) gaps.push_back(ranges[i].begin - ranges[i - 1].end);
  }
  std::ranges::sort(gaps);
  std::size_t closed = 0;
  while (closed < gaps.size() && gaps[closed] <= bytes_of_request &&
         ranges.size() - closed > free_requests + bytes / bytes_of_request)
    bytes += gaps[closed++];
  return closed == 0 ? ranges : join_ranges(std::move(ranges), gaps[closed - 1]);
}

Status CountedSource::read(std::uint64_t offset, std::span<std::byte> out) {
  if (holds_any_ && take_held(offset, out)) return {};
  if (!source_->waits()) return source_->read(offset, out);
  ++requests_;
  SPLATVOL_TRY(source_->read(offset, out));
  count(offset, out.size());
  return {};
}

void CountedSource::count(std::uint64_t offset, std::uint64_t bytes) {
  bytes_read_ += bytes;
  const std::lock_guard lock(count_mutex_);
  std::uint64_t begin = offset, end = offset + bytes, known = 0;
  // Joins the range with those that it meets.
  auto next = ranges_.upper_bound(begin);
  if (next != ranges_.begin() && std::prev(next)->second >= begin) --next;
  while (next != ranges_.end() && next->first <= end) {
    known += std::min(next->second, offset + bytes) - std::min(std::max(next->first, offset), offset + bytes);
    begin = std::min(begin, next->first);
    end = std::max(end, next->second);
    next = ranges_.erase(next);
  }
  ranges_.emplace(begin, end);
  bytes_read_again_ += known;
}

bool CountedSource::take_held(std::uint64_t offset, std::span<std::byte> out) const {
  const std::shared_lock lock(mutex_);
  const std::byte* const held = find_held({offset, offset + out.size()});
  if (held != nullptr) std::copy_n(held, out.size(), out.begin());
  return held != nullptr;
}

// Requires the lock.
const std::byte* CountedSource::find_held(const ByteRange& range) const {
  for (const Held* held : held_)
    if (range.begin >= held->begin && range.end <= held->begin + held->bytes.size() && range.begin <= range.end)
      return held->bytes.data() + (range.begin - held->begin);
  return nullptr;
}

Result<bool> CountedSource::read_parts(std::span<const ByteSource::Part> parts) {
  if (source_->may_read_parts()) ++requests_;
  SPLATVOL_TRY_ASSIGN(read, source_->read_parts(parts));
  if (!read) return false;
  has_read_parts_ = true;
  for (const ByteSource::Part& part : parts) count(part.offset, part.out.size());
  return true;
}

Result<std::shared_ptr<const BytesAhead>> BytesAhead::read(std::shared_ptr<CountedSource> source,
                                                           std::vector<ByteRange> ranges, MemoryShare& share) {
  return read(std::move(source), ranges, join_to_few(ranges), requests_at_once, &share);
}

Result<std::shared_ptr<const BytesAhead>> BytesAhead::read_together(std::shared_ptr<CountedSource> source,
                                                                    std::vector<ByteRange> ranges, std::uint64_t gap) {
  const std::size_t at_once = source->source().may_read_parts() ? requests_at_once : 1;
  return read(std::move(source), ranges, join_ranges(ranges, gap), at_once, nullptr);
}

// `joined`: the ranges for requests of one range each.
Result<std::shared_ptr<const BytesAhead>> BytesAhead::read(std::shared_ptr<CountedSource> source,
                                                           const std::vector<ByteRange>& ranges,
                                                           const std::vector<ByteRange>& joined, std::size_t at_once,
                                                           MemoryShare* share) {
  const bool may_join = source->source().may_read_parts();
  std::shared_ptr<BytesAhead> ahead(new BytesAhead(std::move(source)));
  bool is_read = false;
  if (may_join) {
    if (!ahead->make_room(join_ranges(ranges, bytes_of_part), share)) return nullptr;
    SPLATVOL_TRY_SET(is_read, ahead->read_parts());
  }
  if (!is_read) {
    if (!ahead->make_room(joined, share)) return nullptr;
    static_cast<void>(ahead->source_->prefetch(joined));  // else each read would ask for its bytes alone
    SPLATVOL_TRY(ahead->read_singly(at_once));
  }
  ahead->give_to_source();
  return ahead;
}

Status BytesAhead::read_singly(std::size_t at_once) {
  return run_tasks(held_.size(), at_once, [&](std::size_t i, std::size_t /*thread*/) {
    return source_->read(held_[i].begin, held_[i].bytes);
  });
}

void BytesAhead::give_to_source() const {
  const std::unique_lock lock(source_->mutex_);
  for (const CountedSource::Held& held : held_) source_->held_.push_back(&held);
  source_->holds_any_ = !source_->held_.empty();
}

// Reserves the bytes of ranges, if there is a share. Returns false if a quarter of it has no room for them.
bool BytesAhead::make_room(std::span<const ByteRange> ranges, MemoryShare* share) {
  held_.clear();  // before its memory is given back
  reservation_ = Reservation();
  std::uint64_t bytes = 0;
  for (const ByteRange& range : ranges) bytes += range.end - range.begin;
  if (share) {
    if (bytes > share->capacity() / 4) return false;
    auto reservation = share->reserve(bytes);
    if (!reservation) return false;
    reservation_ = std::move(*reservation);
  }
  for (const ByteRange& range : ranges)
    held_.push_back({range.begin, std::vector<std::byte>(static_cast<std::size_t>(range.end - range.begin))});
  return true;
}

// Returns false if the source knows no requests for many ranges.
Result<bool> BytesAhead::read_parts() {
  std::vector<std::vector<ByteSource::Part>> requests;
  std::uint64_t bytes = 0;
  for (CountedSource::Held& held : held_) {
    if (requests.empty() || requests.back().size() == most_parts || bytes + held.bytes.size() > most_part_bytes) {
      requests.emplace_back();
      bytes = 0;
    }
    requests.back().push_back({held.begin, held.bytes});
    bytes += held.bytes.size();
  }
  std::atomic<bool> knows = true;
  SPLATVOL_TRY(run_tasks(requests.size(), requests_at_once, [&](std::size_t i, std::size_t /*thread*/) -> Status {
    const std::vector<ByteSource::Part>& request = requests[i];
    if (request.size() == 1) return source_->read(request[0].offset, request[0].out);
    SPLATVOL_TRY_ASSIGN(read, source_->read_parts(request));
    if (!read) knows = false;
    return {};
  }));
  return knows.load();
}

BytesAhead::~BytesAhead() {
  const std::unique_lock lock(source_->mutex_);
  std::erase_if(source_->held_, [&](const CountedSource::Held* one) {
    return std::ranges::any_of(held_, [&](const CountedSource::Held& own) { return &own == one; });
  });
  source_->holds_any_ = !source_->held_.empty();
}

}  // namespace splatvol
