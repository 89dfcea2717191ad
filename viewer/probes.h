// The viewer's probes: beside the pointer, and pinned with a plot.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "viewer/probe.h"
#include "viewer/state.h"

namespace splatvol {

/// Asks one question at a time. Between questions about one frame, the frame's splats need not be looked at again.
class Probes {
 public:
  explicit Probes(ViewerState& viewer) : viewer_(viewer) {}

  /// Takes an answer that is there; false: there is none. Called in each frame.
  bool take_answer();

  /// Whether an answer has not been taken yet.
  [[nodiscard]] bool is_busy() const { return answer_.is_begun(); }

  /// Pins the line of sight at a position in the window.
  void pin(const dvec2& position);
  void unpin() { pin_.reset(); }
  [[nodiscard]] bool has_pin() const { return pin_.has_value(); }

  /// Lets go of the session's splats, and of the pin.
  void end();

  /// Draws the probes. Answers come from a job, and only at rest: while the picture changes, its splats are not held
  /// for a probe. `over_picture`: the pointer is not over a control.
  void draw(bool is_at_rest, bool over_picture);

 private:
  struct Question {
    std::uint64_t serial = 0;  // FrameSplats::serial
    TransferFunction function;
    std::optional<TransferFunction> opacity_function;
    Looking looking;
    std::optional<double> opacity;  // as in ProbedFrame::probe
    std::vector<SceneSurface> surfaces = {};

    [[nodiscard]] bool operator==(const Question&) const = default;
  };
  struct Answer {
    std::shared_ptr<const ProbedFrame> frame;
    std::shared_ptr<const ProbedCells> cells;  // null: the file has none, or they cannot be opened
    std::optional<Probe> probe;                // none: the ray meets nothing
  };
  // A line of sight that was clicked on.
  struct Pin {
    Looking looking;
    std::optional<Question> asked = {};  // the question that `probe` answers
    std::optional<Probe> probe = {};
  };
  [[nodiscard]] Looking looking_at(const dvec2& position) const;
  [[nodiscard]] Question question_about(const Looking& looking) const;
  void ask(const Question& question);
  [[nodiscard]] const std::optional<Probe>* answer_to(const Question& question) const;
  void forget();
  [[nodiscard]] std::optional<Probe> with_slices(const std::optional<Probe>& volume, const Ray& ray) const;
  void draw_hovered();
  void draw_pinned();

  ViewerState& viewer_;
  std::optional<Pin> pin_;
  std::optional<Question> asked_;  // that the job answers
  std::optional<Question> answered_;
  Answer last_;  // to it; its frame and cells serve other questions about the frame
  Task<Answer> answer_;
};

}  // namespace splatvol
