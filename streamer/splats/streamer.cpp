#include "streamer/splats/streamer.h"

#include <algorithm>
#include <set>
#include <utility>

#include "base/clock.h"
#include "streamer/splats/streamer_frame.h"
#include "streamer/store/row_bytes.h"

namespace splatvol {
namespace {

// Finds the attributes by their names; `opacity` empty: none.
Result<format::SummaryAttributes> find_attributes(const format::Volume& volume, const std::string& values,
                                                  const std::string& opacity) {
  SPLATVOL_TRY_ASSIGN(values_index, format::find_attribute(volume.info(), values, volume.name()));
  if (opacity.empty()) return format::SummaryAttributes{values_index};
  SPLATVOL_TRY_ASSIGN(opacity_index, format::find_attribute(volume.info(), opacity, volume.name()));
  return format::SummaryAttributes{values_index, opacity_index};
}

}  // namespace

Streamer::Streamer(std::shared_ptr<const format::Volume> volume, const format::SummaryAttributes& attributes,
                   const StreamerOptions& options)
    : volume_(std::move(volume)),
      kernel_(options.kernel),
      threads_(std::max(options.threads, 1U)),
      hide_(options.hide),
      on_data_(options.on_data),
      own_(options.room ? std::nullopt : std::optional(own_room(options.memory_bytes))),
      paged_(*volume_, attributes, options.room ? *options.room : *own_) {}

Streamer::~Streamer() = default;

Result<std::unique_ptr<Streamer>> Streamer::open(std::unique_ptr<ByteSource> source, const StreamerOptions& options) {
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  return open(std::move(volume), options);
}

Result<std::unique_ptr<Streamer>> Streamer::open(std::shared_ptr<const format::Volume> volume,
                                                 const StreamerOptions& options) {
  SPLATVOL_TRY_ASSIGN(attributes, find_attributes(*volume, options.attribute, options.opacity_attribute));
  std::unique_ptr<Streamer> streamer(new Streamer(std::move(volume), attributes, options));
  SPLATVOL_TRY_SET(streamer->reader_, RowReader::create(streamer->paged_, options.kernel, options.gradients));
  SPLATVOL_TRY(streamer->set_memory_aside());
  return streamer;
}

ShownAttributes Streamer::shown_attributes() const {
  const auto [values, opacity] = paged_.attributes();
  const auto& attributes = info().attributes;
  return {attributes[static_cast<std::size_t>(values)],
          opacity < 0 ? nullptr : &attributes[static_cast<std::size_t>(opacity)]};
}

ValueVisibility Streamer::visibility_of(const Transfer& transfer, const View& view) const {
  return {transfer, shown_attributes(), units().length, !view.slices.empty()};
}

Status Streamer::set_step(std::size_t step) {
  if (prefetch_ && prefetch_->step() == step) {
    StepParts read = prefetch_->take();
    prefetch_.reset();
    for (PartLoad& part : read.parts) insert(room(), std::move(part));
    if (read.volume) return set_step(std::move(read.volume));
  }
  SPLATVOL_TRY_ASSIGN(volume, volume_->at_step(step));
  return set_step(std::move(volume));
}

// The parts of rows of the step that the frame consists of, in the order of their keys.
std::vector<PartLoad> Streamer::step_rows_of_frame() {
  std::vector<PartLoad> rows;
  const auto plan = reader_->plan(frame_->cut, frame_->visibility);
  if (!plan) return rows;
  std::set<PartKey> keys;
  for (const RowPart& part : *plan)
    for (const PartKey& key : reader_->keys(part.row))
      if (key.step > 0 && keys.insert(key).second) rows.push_back(reader_->load_of(part.row, key));
  std::ranges::sort(rows, {}, &PartLoad::key);
  return rows;
}

// Adds the index pages from which the frame was chosen, as at another step. Without memory for a page, it stops.
void Streamer::add_index_pages(std::size_t step, std::vector<PartLoad>& pages) {
  std::set<PartKey> keys = paged_.used().keys;
  if (pager_)
    for (const auto& [key, held] : pager_->pages().held) keys.insert(key);
  for (PartKey key : keys) {
    if (key.kind == format::directory_page) continue;
    const auto structure = room().find<format::IndexPage>(key);
    key.step = step + 1;
    if (!structure || room().holds(key)) continue;
    auto room = share().reserve_free(structure->memory_bytes());
    if (!room) return;
    pages.push_back(load_part(key, IndexPageLoad{{}, 0, {}, structure}));
    pages.back().decoded = std::move(*room);
  }
}

// Adds the directory pages that name the chunks of a row. Returns false without memory for one.
bool Streamer::add_directory_pages(std::size_t step, const PartLoad& row, std::vector<PartLoad>& pages) {
  for (const ChunkLoad& chunk : row.row().chunks) {
    const std::uint64_t number = volume_->directory_page_of_row(chunk.row, chunk.column);
    const PartKey key{room().file, format::directory_page, number, -1, step + 1};
    if (std::ranges::find(pages, key, &PartLoad::key) != pages.end()) continue;
    auto room = share().reserve_free(paged_.directory_page_bytes(number));
    if (!room) return false;
    pages.push_back(load_part(key, DirectoryPageLoad()));
    pages.back().decoded = std::move(*room);
  }
  return true;
}

void Streamer::prefetch_step(std::size_t step) {
  if (!frame_ || !volume_->series() || step >= volume_->series()->steps.size()) return;
  if (step == volume_->step() || (prefetch_ && prefetch_->step() == step)) return;
  prefetch_.reset();
  auto working = share().reserve_free(format::max_preamble_bytes + step_run_bytes + reader_->working_bytes());
  if (!working) return;

  std::vector<PartLoad> pages, rows;
  add_index_pages(step, pages);
  for (PartLoad& row : step_rows_of_frame()) {
    row.key.step = step + 1;
    if (room().holds(row.key)) continue;
    if (!add_directory_pages(step, row, pages)) break;
    auto room = share().reserve_free(decoded_bytes(row));
    if (!room) break;
    row.decoded = std::move(*room);
    rows.push_back(std::move(row));
  }
  prefetch_ = std::make_unique<StepAhead<StepParts>>(
      step, [from = volume_, step, attributes = paged_.attributes(), pages = std::move(pages), rows = std::move(rows),
             working = std::move(*working)]() mutable {
        return read_step_parts(*from, step, attributes, std::move(pages), std::move(rows), std::move(working));
      });
}

// The pager, the frame and what hides others belong to the step before.
Status Streamer::set_step(std::shared_ptr<const format::Volume> volume) {
  const auto [values, opacity] = shown_attributes();
  SPLATVOL_TRY_ASSIGN(attributes, find_attributes(*volume, values.name, opacity ? opacity->name : ""));
  const bool gradients = reader_->has_gradients();
  prefetch_.reset();
  pager_.reset();
  target_.reset();
  frame_.reset();
  coarsest_frame_.reset();
  occlusion_.reset();
  filled_ = {};
  view_before_.reset();
  const bool is_same_file = volume->is_same_file(*volume_);
  if (own_ && !is_same_file) own_->table->clear(own_->file);
  const auto before = std::exchange(volume_, std::move(volume));  // paged_ and reader_ still refer to it
  paged_.set_step(*volume_, attributes, is_same_file ? room() : room_in(*room().table, share()));
  SPLATVOL_TRY_SET(reader_, RowReader::create(paged_, kernel_, gradients));
  fixed_ = Reservation();
  return set_memory_aside();
}

Result<const FrameSplats*> Streamer::request(const View& view, const Transfer& transfer, const Detail& detail) {
  SPLATVOL_TRY(check_detail(detail));
  clip_ = view.clip;
  slices_ = view.slices;
  target_.reset();
  pager_.reset();
  coarsest_frame_.reset();
  cut_seconds_ = fetch_seconds_ = 0;
  const ValueVisibility visibility = visibility_of(transfer, view);
  for (Detail tried = detail;;) {
    const auto cut_start = Clock::now();
    auto choice = choose(view, visibility, tried);
    cut_seconds_ += seconds_since(cut_start);
    if (!choice) {
      frame_.reset();
      if (choice.error().code == ErrorCode::out_of_budget) return fail_for_memory(view, visibility, detail);
      return tl::unexpected(choice.error());
    }
    const Detail chosen = choice->detail;
    const bool same = shows(visibility) && frame_->cut == choice->cut;
    if (!same) {
      const auto fetch_start = Clock::now();
      const Status fetched = fetch(std::move(choice->cut), visibility);
      fetch_seconds_ += seconds_since(fetch_start);
      if (!fetched) {
        // A step that is being read ahead has taken memory, or rows need more than rows do.
        if (fetched.error().code != ErrorCode::out_of_budget) return tl::unexpected(fetched.error());
        tried = chosen;
        const bool was_reading = prefetch_ != nullptr;
        prefetch_.reset();
        if (was_reading || make_coarser(tried)) continue;
        return tl::unexpected(fetched.error());
      }
    }
    frame_->splats.detail = chosen;
    frame_->splats.progress = {};
    return &frame_->splats;
  }
}

std::vector<DrawnNode> Streamer::drawn_nodes() const {
  std::vector<DrawnNode> nodes;
  if (!frame_) return nodes;
  for (const std::uint32_t i : frame_->drawn_items) {
    const CutItem& item = frame_->cut.items[i];
    nodes.push_back({item.cube, item.resolution});
  }
  return nodes;
}

StreamerStatistics Streamer::statistics() const {
  const MemoryBudget& budget = share().budget();
  return {volume_->bytes_read(),       budget.used(),      budget.peak(), cut_seconds_, fetch_seconds_,
          volume_->bytes_read_again(), volume_->requests()};
}

}  // namespace splatvol
