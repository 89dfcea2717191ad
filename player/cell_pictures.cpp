#include "player/cell_pictures.h"

#include <utility>

#include "streamer/cells/file_cells.h"

namespace splatvol {

CellPictures::CellPictures() = default;

CellPictures::~CellPictures() = default;

void CellPictures::use(const Streamer& streamer, std::shared_ptr<PlayerMemory> memory) {
  drop();
  ahead_.reset();
  sweep_room_ = {};
  streamer_ = &streamer;
  memory_ = std::move(memory);
}

void CellPictures::drop() {
  in_view_.reset();
  kept_.reset();
  volume_.reset();
}

void CellPictures::take_ahead(std::size_t step) {
  const auto ahead = std::move(ahead_);
  if (!ahead || ahead->step() != step) return;
  ahead->stop();
  auto [volume, kept] = ahead->take();
  volume_ = std::move(volume), kept_ = std::move(kept);
}

// What cannot be read is left out: whoever shows the step meets the error.
CellPictures::Ahead CellPictures::read_step(const format::Steps& steps, std::size_t step, const Scene& scene,
                                            const PartRoom& room) {
  const auto volume = steps.volume(step);
  if (!volume || (*volume)->is_far()) return {};
  const auto kept = KeptCells::open(**volume, scene, room);
  if (!kept) return {};
  static_cast<void>((*kept)->hold_all());
  return {*volume, *kept};
}

void CellPictures::read_ahead(const format::Steps& steps, std::size_t step, const Scene& scene) {
  if ((ahead_ && ahead_->step() == step) || streamer_->volume().is_far()) return;
  ahead_.reset();
  const bool is_other = kept_ && &kept_->share() == &memory_->next_cells;
  MemoryShare& share = is_other ? memory_->cells : memory_->next_cells;
  const PartRoom room = steps.are_files() ? room_in(memory_->table, share) : streamer_->room().in(share);
  ahead_share_ = &share;
  ahead_ = std::make_unique<StepAhead<Ahead>>(
      step, [steps, step, scene, room] { return read_step(steps, step, scene, room); });
}

Result<std::shared_ptr<const KeptCells>> CellPictures::kept(const Scene& scene) {
  if (kept_ && kept_->color_attribute() != contours_of(scene).attribute) drop();
  if (!kept_) {
    volume_ = streamer_->shared_volume();
    const bool is_taken = ahead_ && ahead_share_ == &memory_->cells;
    MemoryShare& share = is_taken ? memory_->next_cells : memory_->cells;
    SPLATVOL_TRY_SET(kept_, KeptCells::open(*volume_, scene, streamer_->room().in(share)));
  }
  return kept_;
}

// An estimate and the pictures of a view at rest read the entries of chunks once.
Result<std::shared_ptr<const FileCells>> CellPictures::in_view(const Scene& scene, const View& view,
                                                               std::uint64_t revision) {
  SPLATVOL_TRY_ASSIGN(kept, this->kept(scene));
  if (!in_view_ || revision_ != revision) {
    SPLATVOL_TRY_SET(in_view_, FileCells::open(std::move(kept), scene, view));
    revision_ = revision;
  }
  return in_view_;
}

std::optional<SharedCells> CellPictures::shared(const Scene& scene) {
  if (streamer_->volume().is_far() && !are_held(scene)) return {};
  const auto kept = this->kept(scene);
  if (!kept || (*kept)->unknown_cells() > 0) return {};
  return SharedCells{memory_, volume_, *kept};
}

bool CellPictures::are_held(const Scene& scene) const {
  return kept_ && kept_->are_held() && kept_->color_attribute() == contours_of(scene).attribute;
}

bool CellPictures::may_be_held(const Scene& scene) {
  const auto kept = this->kept(scene);
  return kept && (*kept)->may_hold_all();
}

std::function<Status()> CellPictures::reader(const Scene& scene) {
  if (streamer_->volume().is_far() || are_held(scene) || !may_be_held(scene)) return {};
  return [memory = memory_, volume = volume_, kept = kept_] { return kept->hold_all(); };
}

// What waits while cells are drawn has its share from the first time on: the memory stays between pictures.
Result<CellPicture> CellPictures::draw(const FileCells& cells, CellDrawing drawing) {
  if (sweep_room_.bytes() == 0)
    if (auto room = memory_->sweep.reserve(memory_->sweep.capacity())) sweep_room_ = std::move(*room);
  drawing.memory = sweep_room_.bytes();
  return rasterizer_.draw(cells, drawing, std::exchange(spare_, {}));
}

}  // namespace splatvol
