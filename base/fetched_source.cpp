#include "base/fetched_source.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace splatvol {
namespace {

thread_local FetchedBytes* current = nullptr;

// Calls visit(entry) for those of a map of ranges, by their begins, that meet a range. `end_of(entry)`: their ends.
template <class Map, class EndOf, class Visit>
void visit_meeting(Map& map, const ByteRange& range, const EndOf& end_of, const Visit& visit) {
  auto at = map.upper_bound(range.begin);
  if (at != map.begin() && end_of(*std::prev(at)) > range.begin) --at;
  for (; at != map.end() && at->first < range.end; ++at) visit(*at);
}

constexpr auto end_of_held = [](const auto& held) { return held.first + held.second.bytes->size(); };
constexpr auto end_of_asked = [](const auto& asked) { return asked.second.end; };

class SharedSource final : public ByteSource {
 public:
  explicit SharedSource(std::shared_ptr<FetchedSource> source) : source_(std::move(source)) {}

  [[nodiscard]] std::uint64_t size() const override { return source_->size(); }
  [[nodiscard]] const std::string& name() const override { return source_->name(); }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return source_->cheap_gap(); }
  [[nodiscard]] bool waits() const override { return source_->waits(); }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    return source_->read(offset, out);
  }
  [[nodiscard]] bool prefetch(std::span<const ByteRange> ranges) override { return source_->prefetch(ranges); }

 private:
  std::shared_ptr<FetchedSource> source_;
};

}  // namespace

FetchedBytes* FetchedBytes::of_thread() { return current; }

FetchedBytes::Scope::Scope(FetchedBytes* bytes) : before_(std::exchange(current, bytes)) {}

FetchedBytes::Scope::~Scope() { current = before_; }

FetchedSource::FetchedSource(std::string name, std::uint64_t size, std::uint64_t most_bytes)
    : name_(std::move(name)), size_(size), most_bytes_(most_bytes) {}

std::unique_ptr<ByteSource> FetchedSource::share(std::shared_ptr<FetchedSource> source) {
  return std::make_unique<SharedSource>(std::move(source));
}

Status FetchedSource::read(std::uint64_t offset, std::span<std::byte> out) {
  SPLATVOL_TRY(check_range(*this, offset, out.size()));
  const ByteRange range{offset, offset + out.size()};
  const std::scoped_lock lock(mutex_);
  if (auto error = take_error(range)) return tl::unexpected(*std::move(error));
  if (!want(range)) return fail(ErrorCode::pending, "{}: its bytes have not come yet", name_);
  use(range, out);
  return {};
}

bool FetchedSource::prefetch(std::span<const ByteRange> ranges) {
  const std::scoped_lock lock(mutex_);
  bool has_all = true;
  for (const ByteRange& range : ranges) has_all = want({range.begin, std::min(range.end, size_)}) && has_all;
  return has_all;
}

// Wants what is missing. Returns whether nothing is.
bool FetchedSource::want(const ByteRange& range) {
  if (current) use(range, {});
  for (const ByteRange& missing : missing_in(range)) {
    asked_.emplace(missing.begin, Asked{.end = missing.end});
    wanted_.push_back(missing);
  }
  bool has_all = true;
  visit_meeting(asked_, range, end_of_asked, [&](auto& asked) {
    if (asked.second.error) return;  // a read tells it
    has_all = false;
    std::erase_if(asked.second.by, [](const auto& by) { return by.expired(); });
    const auto is_it = [&](const auto& by) { return by.lock() == current->blocks_; };
    if (current && std::ranges::none_of(asked.second.by, is_it)) asked.second.by.push_back(current->blocks_);
  });
  return has_all;
}

// The parts of a range that are neither there nor asked for.
std::vector<ByteRange> FetchedSource::missing_in(const ByteRange& range) const {
  std::vector<ByteRange> known, missing;
  visit_meeting(held_, range, end_of_held, [&](const auto& held) { known.push_back({held.first, end_of_held(held)}); });
  visit_meeting(asked_, range, end_of_asked, [&](const auto& asked) {
    known.push_back({asked.first, asked.second.end});
  });
  std::ranges::sort(known, {}, &ByteRange::begin);
  std::uint64_t next = range.begin;
  for (const auto& [begin, end] : known) {
    if (begin > next) missing.push_back({next, begin});
    next = std::max(next, end);
  }
  if (next < range.end) missing.push_back({next, range.end});
  return missing;
}

// An error is told once.
std::optional<Error> FetchedSource::take_error(const ByteRange& range) {
  std::optional<std::uint64_t> failed;
  visit_meeting(asked_, range, end_of_asked, [&](const auto& asked) {
    if (asked.second.error) failed = asked.first;
  });
  if (!failed) return std::nullopt;
  std::optional<Error> error = std::move(asked_.at(*failed).error);
  asked_.erase(*failed);
  return error;
}

// Copies bytes that are there, if `out` has room for them. They stay while the operation lives.
void FetchedSource::use(const ByteRange& range, std::span<std::byte> out) {
  visit_meeting(held_, range, end_of_held, [&](auto& held) {
    held.second.used = ++uses_;
    const std::shared_ptr<const Block>& bytes = held.second.bytes;
    if (current) current->blocks_->add(bytes);
    if (out.empty()) return;
    const std::uint64_t begin = std::max(range.begin, held.first), end = std::min(range.end, end_of_held(held));
    std::copy_n(bytes->begin() + static_cast<std::ptrdiff_t>(begin - held.first), end - begin,
                out.begin() + static_cast<std::ptrdiff_t>(begin - range.begin));
  });
}

std::vector<ByteRange> FetchedSource::take_wanted() {
  const std::scoped_lock lock(mutex_);
  for (const ByteRange& range : wanted_) asked_.at(range.begin).is_taken = true;
  return std::exchange(wanted_, {});
}

void FetchedSource::deliver(const ByteRange& range, std::vector<std::byte> bytes) {
  const std::scoped_lock lock(mutex_);
  const auto asked = asked_.find(range.begin);
  const bool is_it = asked != asked_.end() && asked->second.is_taken && asked->second.end == range.end;
  if (!is_it || bytes.size() != range.end - range.begin) return;
  auto block = std::make_shared<const Block>(std::move(bytes));
  for (const auto& by : asked->second.by)
    if (const auto blocks = by.lock()) blocks->add(block);
  asked_.erase(asked);
  held_bytes_ += block->size();
  held_.emplace(range.begin, Held{std::move(block), ++uses_});
  drop_unused();
}

void FetchedSource::refuse(const ByteRange& range, Error error) {
  const std::scoped_lock lock(mutex_);
  const auto asked = asked_.find(range.begin);
  if (asked != asked_.end() && asked->second.is_taken && asked->second.end == range.end)
    asked->second.error = std::move(error);
}

// The least recently used first.
void FetchedSource::drop_unused() {
  if (held_bytes_ <= most_bytes_) return;
  std::vector<std::pair<std::uint64_t, std::uint64_t>> unused;  // when it was used, offset
  std::uint64_t bytes = 0;
  for (const auto& [offset, held] : held_) {
    if (held.bytes.use_count() > 1) continue;
    unused.emplace_back(held.used, offset);
    bytes += held.bytes->size();
  }
  std::ranges::sort(unused);
  for (const auto& [used, offset] : unused) {
    if (bytes <= most_bytes_) return;
    const auto held = held_.find(offset);
    bytes -= held->second.bytes->size();
    held_bytes_ -= held->second.bytes->size();
    held_.erase(held);
  }
}

bool FetchedSource::is_waiting() const {
  const std::scoped_lock lock(mutex_);
  return std::ranges::any_of(asked_, [](const auto& asked) { return !asked.second.error; });
}

std::uint64_t FetchedSource::held_bytes() const {
  const std::scoped_lock lock(mutex_);
  return held_bytes_;
}

}  // namespace splatvol
