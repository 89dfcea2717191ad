#include "renderer/gl/record_pages.h"

#include <algorithm>
#include <functional>
#include <initializer_list>

namespace splatvol {

namespace {

constexpr std::uint64_t fewest_slots = 1024;  // of a page

template <class Row>
const std::byte* bytes_of(const Row& row) {
  return std::visit([](const auto& records) { return reinterpret_cast<const std::byte*>(records.data()); },
                    row.records());
}

}  // namespace

RecordPages::RecordPages(KernelKind kind, std::uint64_t page_bytes)
    : shape_bytes_(kind == KernelKind::octant ? sizeof(OctantShape) : sizeof(MomentsShape)),
      value_bytes_(kind == KernelKind::octant ? sizeof(OctantValue) : sizeof(MomentsValue)),
      slots_per_page_(static_cast<std::uint32_t>(
          std::max<std::uint64_t>(std::min(page_bytes, largest_buffer()) / (slot_records * largest_bytes()), 1))) {}

std::uint32_t RecordPages::capacity() const {
  return pages_.empty() ? 0 : (static_cast<std::uint32_t>(pages_.size()) - 1) * slots_per_page_ + pages_.back().slots;
}

Status RecordPages::hold(std::span<const DrawRange> ranges, std::uint64_t budget) {
  const bool has_opacity = !ranges.empty() && std::ranges::all_of(ranges, [](const DrawRange& range) {
    return !range.row.values->opacity().records.empty();
  });
  const bool same_layout = has_opacity == this->has_opacity();
  opacity_bytes_ = has_opacity ? sizeof(OpacityValue) : 0;
  if (!same_layout || bytes() > budget) {  // a picture has become larger: pages do not shrink
    forget_rows();
    pages_.clear();
  }
  ++list_;
  std::vector<Missing> missing = find_missing(ranges);
  if (Status made = make_room(missing.size(), budget); !made) {
    // Rows of the list may have slots that it does not need.
    forget_rows();
    missing = find_missing(ranges);
    SPLATVOL_TRY(make_room(missing.size(), budget));
  }
  for (const Missing& wanted : missing) wanted.held->slots[wanted.index] = take_slot();
  upload(missing);
  return check_gl("uploading splats");
}

void RecordPages::forget_rows() {
  rows_.clear();
  free_.clear();
  end_ = 0;
}

// Finds the slots that are not resident, each once. Marks all rows as drawn.
std::vector<RecordPages::Missing> RecordPages::find_missing(std::span<const DrawRange> ranges) {
  std::vector<Missing> missing;
  for (const DrawRange& range : ranges) {
    if (range.count == 0) continue;
    HeldRow& held = rows_[key_of(range)];
    if (held.slots.empty()) {
      held.shapes = range.row.shapes;
      held.values = range.row.values;
      held.slots.assign((range.row.shapes->size() + slot_records - 1) / slot_records, no_slot);
    }
    held.drawn = list_;
    const std::uint32_t last = (range.begin + range.count - 1) / slot_records;
    for (std::uint32_t index = range.begin / slot_records; index <= last; ++index)
      if (held.slots[index] == no_slot) missing.push_back({&held, &range.row, index});
  }
  // Ranges may share a slot.
  const auto by_slot = [](const Missing& a, const Missing& b) {
    return a.held != b.held ? std::less<>()(a.held, b.held) : a.index < b.index;
  };
  if (!std::ranges::is_sorted(missing, by_slot)) std::ranges::sort(missing, by_slot);
  const auto same = [](const Missing& a, const Missing& b) { return a.held == b.held && a.index == b.index; };
  missing.erase(std::unique(missing.begin(), missing.end(), same), missing.end());
  return missing;
}

// Makes sure that `count` slots are free. Rows leave first to which nothing refers. Then pages grow. Rows that the
// present list does not have leave last.
Status RecordPages::make_room(std::uint64_t count, std::uint64_t budget) {
  if (available() >= count) return {};
  release_dropped();
  const Status grown = available() < count ? grow(count - available(), budget) : Status{};
  if (available() < count) release_least_recent(count);
  if (available() >= count) return {};
  SPLATVOL_TRY(grown);
  return fail(ErrorCode::out_of_budget, "the splats take more than the {} bytes of the device that are left for them",
              budget);
}

Status RecordPages::grow(std::uint64_t count, std::uint64_t budget) {
  const std::uint64_t needed = capacity() + count, most = budget / slot_bytes();
  while (capacity() < std::min(needed, most)) {
    if (pages_.empty() || pages_.back().slots == slots_per_page_) pages_.emplace_back();
    Page& page = pages_.back();
    const std::uint64_t wanted =
        std::max({fewest_slots, std::uint64_t{2} * page.slots, page.slots + needed - capacity()});
    const std::uint64_t slots = std::min({wanted, std::uint64_t{slots_per_page_}, page.slots + most - capacity()});
    Status resized = resize(page, static_cast<std::uint32_t>(slots));
    if (!resized) {
      if (page.slots == 0) pages_.pop_back();
      return resized;
    }
  }
  return {};
}

// Enlarges a page, which keeps what it holds.
Status RecordPages::resize(Page& page, std::uint32_t slots) {
  struct Copy {
    std::size_t from, to, bytes;
  };
  const auto enlarge = [&](Buffer& buffer, std::uint32_t record_bytes, std::initializer_list<Copy> copies) -> Status {
    Buffer larger(buffer.name());
    SPLATVOL_TRY(larger.reserve(std::size_t{slots} * slot_records * record_bytes));
    for (const auto& [from, to, bytes] : copies)
      if (bytes > 0)
        glCopyNamedBufferSubData(buffer.object(), larger.object(), static_cast<GLintptr>(from),
                                 static_cast<GLintptr>(to), static_cast<GLsizeiptr>(bytes));
    buffer = std::move(larger);
    return {};
  };
  const std::size_t records = std::size_t{page.slots} * slot_records, values = values_offset(page.slots);
  SPLATVOL_TRY(enlarge(page.shapes, shape_bytes_, {{0, 0, records * shape_bytes_}}));
  SPLATVOL_TRY(enlarge(page.values, value_bytes_ + opacity_bytes_,
                       {{0, 0, values}, {values, values_offset(slots), records * opacity_bytes_}}));
  page.slots = slots;
  return {};
}

void RecordPages::release(const HeldRow& row) {
  for (const std::uint32_t slot : row.slots)
    if (slot != no_slot) free_.push_back(slot);
}

// Releases rows that cannot be drawn again, because nothing has them any more.
void RecordPages::release_dropped() {
  std::erase_if(rows_, [&](const auto& entry) {
    const HeldRow& row = entry.second;
    if (row.drawn == list_ || !(row.shapes.expired() || row.values.expired())) return false;
    release(row);
    return true;
  });
  std::ranges::sort(free_, std::greater());
}

void RecordPages::release_least_recent(std::uint64_t count) {
  std::vector<std::pair<std::uint64_t, RowKey>> candidates;
  for (const auto& [key, row] : rows_)
    if (row.drawn != list_) candidates.emplace_back(row.drawn, key);
  std::ranges::sort(candidates, {}, [](const auto& candidate) {
    return std::tuple(candidate.first, candidate.second.shapes, candidate.second.values);
  });
  for (const auto& [drawn, key] : candidates) {
    if (available() >= count) break;
    const auto found = rows_.find(key);
    release(found->second);
    rows_.erase(found);
  }
  std::ranges::sort(free_, std::greater());
}

std::uint32_t RecordPages::take_slot() {
  if (free_.empty()) return end_++;
  const std::uint32_t slot = free_.back();
  free_.pop_back();
  return slot;
}

// Writes neighbours together.
void RecordPages::upload(std::span<const Missing> missing) {
  for (std::size_t first = 0, end = 0; first < missing.size(); first = end) {
    const auto slot = [&](std::size_t i) { return missing[i].held->slots[missing[i].index]; };
    for (end = first + 1; end < missing.size(); ++end) {
      const auto ahead = static_cast<std::uint32_t>(end - first);
      if (missing[end].held != missing[first].held || missing[end].index != missing[first].index + ahead ||
          slot(end) != slot(first) + ahead || slot(end) % slots_per_page_ == 0)
        break;
    }
    write(missing[first], static_cast<std::uint32_t>(end - first));
  }
}

void RecordPages::write(const Missing& first, std::uint32_t slots) {
  const std::uint32_t slot = first.held->slots[first.index];
  Page& page = pages_[slot / slots_per_page_];
  const std::size_t at = std::size_t{slot % slots_per_page_} * slot_records;
  const std::size_t record = std::size_t{first.index} * slot_records;
  const std::size_t count = std::min(std::size_t{slots} * slot_records, first.row->shapes->size() - record);
  page.shapes.write_at(at * shape_bytes_, bytes_of(*first.row->shapes) + record * shape_bytes_, count * shape_bytes_);
  page.values.write_at(at * value_bytes_, bytes_of(*first.row->values) + record * value_bytes_, count * value_bytes_);
  if (opacity_bytes_ > 0)
    page.values.write_at(values_offset(page.slots) + at * opacity_bytes_,
                         first.row->values->opacity().records.data() + record, count * opacity_bytes_);
  uploaded_bytes_ += count * (shape_bytes_ + value_bytes_ + opacity_bytes_);
}

}  // namespace splatvol
