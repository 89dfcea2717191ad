// The next file of a series of files, opened on a thread of its own.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <future>
#include <memory>
#include <stop_token>

#include "base/interruption.h"
#include "format/steps.h"
#include "scene/scene.h"
#include "streamer/cells/file_cells.h"

namespace splatvol {

/// Opens the file of a step. Its destruction does not wait for a server. Where no thread starts, volume() opens it.
class StepAhead {
 public:
  StepAhead(const format::Steps& steps, std::size_t step)
      : step_(step),
        volume_(std::async(std::launch::async | std::launch::deferred, [steps, step, stop = stop_.get_token()] {
          const Interruptible interruptible(stop);
          return steps.volume(step);
        })) {}
  StepAhead(const StepAhead&) = delete;
  StepAhead& operator=(const StepAhead&) = delete;
  ~StepAhead() { stop_.request_stop(); }

  [[nodiscard]] std::size_t step() const { return step_; }
  [[nodiscard]] bool is_done() const {
    return volume_.wait_for(std::chrono::seconds(0)) != std::future_status::timeout;
  }

  /// Waits for it. Called once, at the end.
  [[nodiscard]] Result<std::shared_ptr<const format::Volume>> volume() { return volume_.get(); }

 private:
  std::size_t step_;
  std::stop_source stop_;
  std::future<Result<std::shared_ptr<const format::Volume>>> volume_;
};

/// The cells of a step, read on a thread of its own. What cannot be read is left out: whoever shows the step meets the
/// error.
class StepCells {
 public:
  /// `room`: of the step's file, in a share that belongs to no other cells then.
  StepCells(const format::Steps& steps, std::size_t step, const Scene& scene, const PartRoom& room)
      : step_(step),
        share_(*room.share),
        cells_(std::async(std::launch::async | std::launch::deferred,
                          [steps, step, scene, room, stop = stop_.get_token()]() -> Cells {
                            const Interruptible interruptible(stop);
                            const auto volume = steps.volume(step);
                            if (!volume || (*volume)->is_far()) return {};
                            const auto kept = KeptCells::open(**volume, scene, room);
                            if (!kept) return {};
                            static_cast<void>((*kept)->hold_all());
                            return {*volume, *kept};
                          })) {}
  StepCells(const StepCells&) = delete;
  StepCells& operator=(const StepCells&) = delete;

  /// Waits for the chunk that is being read.
  ~StepCells() { stop_.request_stop(); }

  [[nodiscard]] std::size_t step() const { return step_; }
  [[nodiscard]] const MemoryShare& share() const { return share_; }
  [[nodiscard]] bool is_done() const { return cells_.wait_for(std::chrono::seconds(0)) != std::future_status::timeout; }

  /// The cells belong to the volume. Null: they cannot be read.
  struct Cells {
    std::shared_ptr<const format::Volume> volume = {};
    std::shared_ptr<const KeptCells> kept = {};
  };

  /// Waits for the chunk that is being read. Returns what was read. Called once, at the end.
  [[nodiscard]] Cells take() {
    stop_.request_stop();
    return cells_.get();
  }

 private:
  std::size_t step_;
  MemoryShare& share_;
  std::stop_source stop_;
  std::future<Cells> cells_;
};

}  // namespace splatvol
