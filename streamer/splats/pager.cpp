#include "streamer/splats/pager.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <tuple>

namespace splatvol {
namespace {

using format::DirectoryPage;
using format::IndexPage;

constexpr std::size_t most_failures = 1000;  // then the disk is gone

constexpr int before_all_stages = std::numeric_limits<int>::max();

constexpr std::uint64_t smallest_run_bytes = 16u << 10;
constexpr std::uint64_t largest_run_bytes = 512u << 10;

}  // namespace

Pager::Pager(PagedVolume& paged, RowReader& reader, std::uint64_t bytes_in_flight, unsigned threads,
             std::function<void()> on_data)
    : paged_(paged),
      reader_(reader),
      most_in_flight_(bytes_in_flight),
      loader_(paged.volume(), paged.attributes(), threads, std::move(on_data)) {}

Status Pager::pin_coarsest() {
  SPLATVOL_TRY(paged_.root());
  const format::Volume& volume = paged_.volume();
  const std::uint64_t groups = volume.rows().group_at(0, volume.info().resolution_counts[0] - 1) + 1;
  SPLATVOL_TRY(pin_rows(groups));
  SPLATVOL_TRY(pin_directory_pages(groups));
  return pin_root();
}

Status Pager::pin_rows(std::uint64_t groups) {
  std::vector<RowPart> rows;
  for (std::uint64_t group = 0; group < groups; ++group) rows.push_back({{0, group}, 0, 0, 0});
  const auto held = reader_.hold(rows);
  if (!held && held.error().code == ErrorCode::out_of_budget)
    return fail(ErrorCode::out_of_budget, "{}: no memory for the coarsest splats", paged_.volume().name());
  if (!held) return tl::unexpected(held.error());
  for (const auto& [number, row] : *held) {
    pinned_.push_back(row.shapes);
    pinned_.push_back(row.values);
  }
  return {};
}

// Reads the pages again: pinning the rows may have dropped some of them.
Status Pager::pin_directory_pages(std::uint64_t groups) {
  std::set<std::uint64_t> pages;
  for (std::uint64_t group = 0; group < groups; ++group)
    for (const PartKey& key : reader_.keys({0, group}))
      for (const auto& [row, column] : reader_.chunks({0, group}, key.kind)) {
        const std::uint64_t page = paged_.volume().directory_page_of_row(row, column);
        if (!pages.insert(page).second) continue;
        SPLATVOL_TRY(paged_.find_chunk(row, column));
        pinned_.push_back(room().find<void>(paged_.directory_key(page)));
      }
  return {};
}

Status Pager::pin_root() {
  SPLATVOL_TRY_ASSIGN(root, paged_.root());
  largest_index_page_ = 4 * root->memory_bytes();
  pinned_.push_back(room().find<void>(paged_.root_key()));
  return {};
}

void Pager::forget(const ValueVisibility& visibility) {
  if (!visibility_ || *visibility_ != visibility) rows_.clear();
  visibility_ = visibility;
  wants_.clear();
  pages_ahead_.clear();
  too_large_.clear();
}

void Pager::keep_pages_and_ask_ahead(Pages pages) {
  pages_ahead_ = std::exchange(pages_, std::move(pages)).missing;
  for (const auto& [key, load] : pages_.missing) pages_ahead_.erase(key);
}

PartPointer Pager::find_page(const PartKey& key) {
  const auto held = pages_.held.find(key);
  if (held != pages_.held.end()) return held->second;
  PartPointer page = room().find<void>(key);
  if (!page) return page;
  if (key.kind != format::directory_page) pages_.index_bytes += part_as<IndexPage>(page)->memory_bytes();
  pages_.held.emplace(key, page);
  return page;
}

Result<std::shared_ptr<const IndexPage>> Pager::root() { return part_as<IndexPage>(find_page(paged_.root_key())); }

Result<std::shared_ptr<const IndexPage>> Pager::linked(const IndexPage& page, std::uint32_t node) {
  const format::IndexPageRef& ref = page.pages[page.links[node]];
  const PartKey key = paged_.index_key(ref.offset);
  if (!pages_.held.contains(key) && !pages_.missing.contains(key)) pages_.packed_bytes += ref.front_bytes;
  const PartPointer found = find_page(key);
  if (!found && !pages_.missing.contains(key)) pages_.missing.insert(paged_.load_of_linked(page, node));
  return part_as<IndexPage>(found);
}

const DirectoryPage* Pager::find_directory_page(const RowReader::ChunkName& chunk) {
  const std::uint64_t number = paged_.volume().directory_page_of_row(chunk.row, chunk.column);
  const PartPointer page = find_page(paged_.directory_key(number));
  return part_as<DirectoryPage>(page).get();
}

bool Pager::holds(std::span<const PointRange> ranges) {
  const auto resolution = static_cast<std::uint32_t>(ranges.size() - 1);
  return visit_groups(paged_.volume(), ranges, [&](const GroupPart& part) {
    const State state = state_of({resolution, part.group});
    return state == State::hidden || state == State::ready;
  });
}

Pager::State Pager::state_of(const RowName& name) {
  const auto [found, added] = rows_.try_emplace(name.number());
  if (added) look_up(name, found->second);
  return found->second.state;
}

void Pager::look_up(const RowName& name, Row& row) {
  const RowReader::ChunkName value = reader_.value_chunk(name);
  const DirectoryPage* page = find_directory_page(value);
  if (!page) return;
  const auto summary_in = [&](const DirectoryPage& directory, const RowReader::ChunkName& chunk) {
    return format::summary_of(paged_.volume().find_chunk(directory, chunk.row, chunk.column).entry);
  };
  const format::ValueSummary values = summary_in(*page, value);
  std::optional<format::ValueSummary> opacity;
  if (const auto chunk = reader_.opacity_chunk(name)) {
    const DirectoryPage* opacity_page = find_directory_page(*chunk);
    if (!opacity_page) return;
    opacity = summary_in(*opacity_page, *chunk);
  }
  row.state = State::hidden;
  if (!visibility_->shows_row({values, opacity ? &*opacity : nullptr})) return;

  row.held = {room().find<void>(reader_.shapes_key(name)), room().find<void>(reader_.values_key(name))};
  row.state = row.held.is_whole() ? State::ready : State::missing;
  for (const int kind : {format::row_shapes, format::row_values})
    for (const RowReader::ChunkName& chunk : reader_.chunks(name, kind))
      if (!find_directory_page(chunk)) row.state = State::missing;
}

void Pager::want(const Cut& cut, int stage) {
  for (const CutItem& item : cut.items) {
    if (item.error == 0) continue;
    visit_groups(paged_.volume(), cut.ranges_of(item), [&](const GroupPart& part) {
      const RowName name{item.resolution, part.group};
      const auto [found, added] = wants_.try_emplace(name.number(), Want{name, stage, false, 0});
      Want& wanted = found->second;
      wanted.stage = std::max(wanted.stage, stage);
      wanted.needed = wanted.needed || stage == 0;
      wanted.error = std::max(wanted.error, item.error);
      return true;
    });
  }
}

void Pager::hold_wanted() {
  rows_.clear();
  std::erase_if(pages_.held, [](const auto& page) { return page.first.kind == format::directory_page; });
  for (const auto& [number, want] : wants_)
    if (want.stage >= 0) static_cast<void>(state_of(want.row));
}

void Pager::ask(bool is_final) {
  for (const LoadRun& run : loader_.withdraw())
    for (const PartLoad& part : run) {
      const auto found = in_flight_.find(part.key);
      bytes_in_flight_ -= found->second;
      in_flight_.erase(found);
    }
  hold_wanted();
  for (Request& request : requests()) {
    const PartKey first = request.run.front().key;
    if (submit(std::move(request.run), request.stage >= 0)) continue;
    if (!is_final || is_reading() || request.stage < 0) break;
    note_too_large(first);
  }
}

bool Pager::has_failed(const PartKey& key) const {
  return failed_.contains(key) || too_large_.contains(key) || failed_.size() >= most_failures;
}

void Pager::note_too_large(const PartKey& key) {
  too_large_.insert(key);
  if (!told_.insert(key).second) return;
  errors_.push_back({ErrorCode::out_of_budget, fmt::format("{}: no memory for {} {}", paged_.volume().name(),
                                                           is_of_row(key) ? "row" : "page", key.number)});
}

// Large load runs cost less a byte; small ones let more urgent reads pass earlier.
std::uint64_t Pager::most_run_bytes() const {
  if (paged_.volume().may_join_requests()) return std::clamp(most_in_flight_ / 8, smallest_run_bytes, most_part_bytes);
  return std::clamp(most_in_flight_ / 32, smallest_run_bytes, largest_run_bytes);
}

// Returns requests for all missing parts, those needed most first. Skips intermediate pictures once the final one is
// resident.
std::vector<Pager::Request> Pager::requests() {
  missing_ = {};
  needed_bytes_ = pages_.packed_bytes;
  Collected collected;
  for (const auto& [number, want] : wants_) add_row(want, collected);
  std::map<int, std::vector<PartLoad>> parts_by_stage;
  add_pages(collected.directory_pages, parts_by_stage[before_all_stages]);
  const bool is_there = missing_.rows + missing_.pages == 0;
  for (auto& [key, staged] : collected.parts)
    if (!is_there || staged.stage <= 0) parts_by_stage[staged.stage].push_back(std::move(staged.part));
  for (const auto& [key, load] : pages_ahead_) {
    if (!can_ask(key)) continue;
    parts_by_stage[ahead].push_back(load_part(key, load));
    parts_by_stage[ahead].back().error = 1;
  }
  std::vector<Request> requests;
  for (auto& [stage, parts] : parts_by_stage) {
    std::ranges::stable_sort(parts, std::greater<>(), &PartLoad::error);
    for (LoadRun& run : runs_of(paged_.volume(), std::move(parts), most_run_bytes())) {
      const float error = std::ranges::max_element(run, {}, &PartLoad::error)->error;
      requests.push_back({stage, error, std::move(run)});
    }
  }
  std::ranges::stable_sort(requests, std::greater<>(),
                           [](const Request& request) { return std::tuple(request.stage, request.error); });
  return requests;
}

void Pager::add_pages(const std::set<std::uint64_t>& directory_pages, std::vector<PartLoad>& pages) {
  const auto add = [&](const PartKey& key, auto what) {
    if (can_ask(key)) pages.push_back(load_part(key, std::move(what)));
  };
  for (const auto& [key, what] : pages_.missing) {
    miss(key, missing_.pages);
    missing_.bytes += what.ref.page_bytes;
    add(key, what);
  }
  for (const std::uint64_t number : directory_pages) add(paged_.directory_key(number), DirectoryPageLoad());
}

// Adds the parts of a row that are not there, or the directory pages that name their locations if these are missing.
void Pager::add_row(const Want& want, Collected& collected) {
  const State state = state_of(want.row);
  if (state == State::hidden) return;
  for (const PartKey& key : reader_.keys(want.row)) add_part(want, key, state == State::ready, collected);
}

void Pager::add_part(const Want& want, const PartKey& key, bool is_there, Collected& collected) {
  const format::Volume& volume = paged_.volume();
  PartLoad part = reader_.load_of(want.row, key);
  const bool missing = !is_there && !room().find<void>(key);
  const bool first = want.needed && collected.needed.insert(key).second;
  bool located = true;
  for (ChunkLoad& chunk : std::get<RowLoad>(part.what).chunks) {
    const DirectoryPage* page = find_directory_page({chunk.row, chunk.column});
    if (!page) {
      miss_page(volume.directory_page_of_row(chunk.row, chunk.column), want.needed, collected);
      located = false;
      continue;
    }
    chunk.location = volume.find_chunk(*page, chunk.row, chunk.column);
    if (!first) continue;
    const std::pair name(chunk.row, chunk.column);
    const std::uint64_t bytes = chunk.location.entry.packed_bytes;
    if (collected.needed_chunks.insert(name).second) needed_bytes_ += bytes;
    if (missing && collected.missing_chunks.insert(name).second) missing_.bytes += bytes;
  }
  if (!missing || !located) return;
  if (first) miss(key, missing_.rows);
  if (!can_ask(key)) return;
  const auto [staged, added] = collected.parts.try_emplace(key, want.stage, std::move(part));
  staged->second.stage = std::max(staged->second.stage, want.stage);
  staged->second.part.error = std::max(staged->second.part.error, want.error);
}

void Pager::miss_page(std::uint64_t number, bool needed, Collected& collected) {
  collected.directory_pages.insert(number);
  if (!needed || !collected.needed.insert(paged_.directory_key(number)).second) return;
  miss(paged_.directory_key(number), missing_.pages);
  missing_.bytes += paged_.volume().chunks_of_directory_page(number) * sizeof(format::ChunkEntry);
}

void Pager::miss(const PartKey& key, std::uint64_t& parts) {
  ++parts;
  missing_.failed += has_failed(key) && !in_flight_.contains(key) ? 1 : 0;
}

// Submits the parts of a load run that memory suffices for. Returns whether these are all.
bool Pager::submit(LoadRun run, bool may_evict) {
  LoadRun granted;
  for (PartLoad& part : run) {
    if (!reserve(part, may_evict)) break;
    const std::uint64_t bytes = part.decoded.bytes() + part.working.bytes();
    bytes_in_flight_ += bytes;
    in_flight_[part.key] = bytes;
    granted.push_back(std::move(part));
  }
  const bool all = granted.size() == run.size();
  if (!granted.empty()) loader_.submit(std::move(granted));
  return all;
}

bool Pager::reserve(PartLoad& part, bool may_evict) {
  std::uint64_t decoded = 0, working = 0;
  if (part.key.kind == format::directory_page) {
    decoded = paged_.directory_page_bytes(part.key.number);
    working = paged_.volume().chunks_of_directory_page(part.key.number) * sizeof(format::ChunkEntry);
  } else if (const auto* page = std::get_if<IndexPageLoad>(&part.what)) {
    // The size of a page in memory is known only after unpacking. Pages are about equally large.
    decoded = largest_index_page_;
    working = largest_index_page_ + page->ref.page_bytes;
  } else {
    decoded = decoded_bytes(part);
    working = working_bytes(paged_.volume(), part);
  }
  if (bytes_in_flight_ > 0 && bytes_in_flight_ + decoded + working > most_in_flight_) return false;
  auto data_bytes = may_evict ? room().share->reserve(decoded) : room().share->reserve_free(decoded);
  if (!data_bytes) return false;
  auto working_memory = may_evict ? room().share->reserve(working) : room().share->reserve_free(working);
  if (!working_memory) return false;
  part.decoded = std::move(*data_bytes);
  part.working = std::move(*working_memory);
  return true;
}

Pager::Arrivals Pager::accept_arrivals() {
  Arrivals arrivals;
  for (LoadRun& run : loader_.extract_done())
    for (PartLoad& part : run) arrive(part, arrivals);
  return arrivals;
}

void Pager::arrive(PartLoad& part, Arrivals& arrivals) {
  const auto found = in_flight_.find(part.key);
  bytes_in_flight_ -= found->second;
  in_flight_.erase(found);
  const bool of_row = is_of_row(part.key);
  (of_row ? arrivals.rows : arrivals.pages) = true;
  if (!part.data) {
    failed_.insert(part.key);
    errors_.push_back(part.data.error());
    return;
  }
  if (const auto* page = std::get_if<IndexPage>(&*part.data)) {
    const std::uint64_t bytes = page->memory_bytes();
    largest_index_page_ = std::max(largest_index_page_, bytes);
    part.decoded = Reservation();
    auto reservation = room().share->reserve(bytes);
    if (!reservation) return;
    part.decoded = std::move(*reservation);
  } else if (of_row && !part.decoded.grow(held_bytes(*part.data))) {
    failed_.insert(part.key);
    errors_.push_back({ErrorCode::out_of_budget, fmt::format("{}: no memory for row {}, which has many blocks",
                                                             paged_.volume().name(), part.key.number)});
    return;
  }
  insert(room(), std::move(part));
}

}  // namespace splatvol
