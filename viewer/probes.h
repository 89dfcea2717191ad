// The viewer's probes: beside the pointer, and pinned with a plot.
#pragma once

#include <optional>

#include "viewer/prober.h"
#include "viewer/state.h"

namespace splatvol {

class Probes {
 public:
  explicit Probes(ViewerState& viewer) : viewer_(viewer), prober_(viewer.host) {}

  /// Takes an answer that is there; false: there is none. Called in each frame.
  bool take_answer() { return prober_.take_answer(); }
  [[nodiscard]] bool is_busy() const { return prober_.is_busy(); }

  /// Pins the line of sight at a position in the window.
  void pin(const dvec2& position);
  void unpin() { pin_.reset(); }

  /// Lets go of the session's splats, and of the pin.
  void end();

  /// Draws the probes. Answers come from a job, and only at rest: while the picture changes, its splats are not held
  /// for a probe. `over_picture`: the pointer is not over a control.
  void draw(bool is_at_rest, bool over_picture);

 private:
  // A line of sight that was clicked on.
  struct Pin {
    Looking looking;
    std::optional<Prober::Question> asked = {};  // the question that `probe` answers
    std::optional<Probe> probe = {};
  };
  [[nodiscard]] Looking looking_at(const dvec2& position) const;
  [[nodiscard]] Prober::Question question_about(const Looking& looking) const;
  void ask(const Prober::Question& question);
  [[nodiscard]] std::optional<Probe> with_slices(const std::optional<Probe>& volume, const Ray& ray) const;
  void draw_hovered();
  void draw_pinned();

  ViewerState& viewer_;
  Prober prober_;
  std::optional<Pin> pin_;
};

}  // namespace splatvol
