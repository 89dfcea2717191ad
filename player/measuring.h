// Measures what a window shows: integrals over cells, contours and slices, by a job beside the pictures.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "base/error.h"
#include "format/steps.h"
#include "player/session_host.h"
#include "scene/scene.h"
#include "splatvol/integrals.h"

namespace splatvol {

/// What is measured of a file: cells in a region, or a surface.
struct MeasureRequest {
  std::size_t step = 0;
  std::variant<std::monostate, ContourSurface, HalfSpace> surface = {};  // none: cells
  IntegralRequest integrals = {};
  std::array<std::string, 3> vector = {};  // as that of SurfaceRequest

  [[nodiscard]] bool operator==(const MeasureRequest&) const = default;
};

using Measured = std::variant<Integrals, SurfaceIntegrals>;

/// Returns the region that a scene's clip box and clip planes leave.
[[nodiscard]] IntegralRequest region_of(const Scene& scene);

/// Measures one thing after the other.
class Measuring {
 public:
  /// Begins, and ends what was begun. `steps`: of the file, copied. `memory`: bytes of the file that may be held.
  void begin(SessionHost& host, const format::Steps& steps, const MeasureRequest& request, std::uint64_t memory);

  [[nodiscard]] bool is_begun() const { return task_.is_begun(); }
  [[nodiscard]] const MeasureRequest& request() const { return request_; }

  /// Returns the share that is done, 0 to 1.
  [[nodiscard]] double share() const { return share_ ? share_->load() : 0; }

  /// Returns the result once it is there; none before, and after the call that returned it.
  [[nodiscard]] std::optional<Result<Measured>> take();

  /// Asks for an early end: the result tells whether it came to that.
  void interrupt() { task_.interrupt(); }

  /// Measures no more, and waits for the job.
  void end() { task_.end(); }

 private:
  MeasureRequest request_;
  std::shared_ptr<std::atomic<double>> share_;
  Task<Result<Measured>> task_;
};

/// The areas of a scene's contours and the volumes inside, as a list of contours shows them: whole, not as clip planes
/// cut them.
class ContourMeasures {
 public:
  struct Size {
    double area = 0;
    double volume = 0;  // NaN if the contour is not closed
  };

  /// Measures the contours that are shown and not yet known, one after the other, once the scene has not changed for
  /// .3 s. `seconds`: since the last call. Nothing is measured while `is_held`: somebody drags a value. A failure is
  /// returned once, and its contour not tried again while it is shown.
  [[nodiscard]] Status update(SessionHost& host, const format::Steps& steps, std::size_t step, const Scene& scene,
                              std::uint64_t memory, double seconds, bool is_held);

  /// Returns the size of a contour of the last scene; none if it is not known.
  [[nodiscard]] std::optional<Size> size_of(double value) const;

  /// Whether a call is to come that has something to do.
  [[nodiscard]] bool is_busy() const { return is_pending_ || measuring_.is_begun(); }

  /// Forgets all: for another file.
  void reset();

 private:
  void note_scene(const Scene& scene, std::size_t step, double seconds, bool is_held);
  [[nodiscard]] bool is_wanted(const MeasureRequest& request) const;
  [[nodiscard]] Status take_size();
  [[nodiscard]] std::optional<double> next_unknown() const;

  // What sizes are of, besides the value.
  std::pair<std::string, std::size_t> of_;  // attribute, step
  std::vector<double> values_;              // that are shown, ascending
  double still_seconds_ = 0;
  bool is_pending_ = false;
  std::map<double, std::optional<Size>> sizes_;  // none: it failed
  Measuring measuring_;
};

}  // namespace splatvol
