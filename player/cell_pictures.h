// The cells of an open file, and their pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "base/error.h"
#include "base/memory_budget.h"
#include "format/steps.h"
#include "format/volume.h"
#include "pictures/image.h"
#include "player/player_memory.h"
#include "renderer/cpu/cells.h"
#include "scene/scene.h"
#include "streamer/splats/streamer.h"
#include "streamer/store/step_ahead.h"

namespace splatvol {

class FileCells;
class KeptCells;

/// Cells that stay in memory for whoever has them, on any thread.
struct SharedCells {
  std::shared_ptr<PlayerMemory> memory;  // before what lies in it
  std::shared_ptr<const format::Volume> volume;
  std::shared_ptr<const KeptCells> kept;
};

/// Keeps the cells of the step that a streamer has, and draws them. Errors name the file.
class CellPictures {
 public:
  CellPictures();
  CellPictures(const CellPictures&) = delete;
  CellPictures& operator=(const CellPictures&) = delete;
  ~CellPictures();

  /// Drops all, also the cells of a step that is read ahead. `streamer`: from now on.
  void use(const Streamer& streamer, std::shared_ptr<PlayerMemory> memory);

  /// Drops the cells of a step.
  void drop();

  /// Takes over those of the streamer's step, if they have been read ahead.
  void take_ahead(std::size_t step);

  /// Begins to read all cells of another step on a thread, if the file is near and memory has room for them.
  void read_ahead(const format::Steps& steps, std::size_t step, const Scene& scene);
  [[nodiscard]] bool is_reading_ahead() const { return ahead_ && !ahead_->is_done(); }

  /// Returns the cells with the values that a scene shows. Fails if the file keeps none.
  [[nodiscard]] Result<std::shared_ptr<const KeptCells>> kept(const Scene& scene);

  /// Returns those in the view. `revision`: another one whenever the scene or its view are.
  [[nodiscard]] Result<std::shared_ptr<const FileCells>> in_view(const Scene& scene, const View& view,
                                                                 std::uint64_t revision);

  /// Returns the cells with the values that a scene shows, if all are known and no server is asked for them.
  [[nodiscard]] std::optional<SharedCells> shared(const Scene& scene);

  /// Whether all cells are held: nothing will be read.
  [[nodiscard]] bool are_held(const Scene& scene) const;

  /// Whether memory has room for all.
  [[nodiscard]] bool may_be_held(const Scene& scene);

  /// Returns what reads all cells of a near file, on any thread. Empty if they are held, or will not be.
  [[nodiscard]] std::function<Status()> reader(const Scene& scene);

  /// Draws cells, in the memory that is kept for it.
  [[nodiscard]] Result<CellPicture> draw(const FileCells& cells, CellDrawing drawing);

  /// Takes the memory of a picture for the next one.
  void reuse(Image picture) { spare_ = std::move(picture); }

 private:
  // The cells of a step that was read ahead. They belong to the volume. Null: they cannot be read.
  struct Ahead {
    std::shared_ptr<const format::Volume> volume = {};
    std::shared_ptr<const KeptCells> kept = {};
  };
  [[nodiscard]] static Ahead read_step(const format::Steps& steps, std::size_t step, const Scene& scene,
                                       const PartRoom& room);

  const Streamer* streamer_ = nullptr;
  std::shared_ptr<PlayerMemory> memory_;          // before what lies in it
  Reservation sweep_room_;                        // once cells were drawn
  std::shared_ptr<const format::Volume> volume_;  // of the cells
  std::shared_ptr<const KeptCells> kept_;         // null: none was needed yet
  std::shared_ptr<const FileCells> in_view_;      // of these
  std::uint64_t revision_ = 0;                    // of the view
  std::unique_ptr<StepAhead<Ahead>> ahead_;       // of a series
  const MemoryShare* ahead_share_ = nullptr;      // that belongs to no other cells then
  CellRasterizer rasterizer_;
  Image spare_;  // its memory becomes that of the next picture
};

}  // namespace splatvol
