// What is under the pointer, and what is pinned, with a plot.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "player/pick.h"
#include "player/splat_ray.h"
#include "viewer/state.h"

namespace splatvol {

/// Asks one question at a time. Cells answer, also while a picture is drawn. Where there are none, the splats of the
/// frame do, and between questions about one frame they need not be looked at again.
class Pins {
 public:
  explicit Pins(ViewerState& viewer) : viewer_(viewer) {}

  /// Takes an answer that is there; false: there is none. Called in each frame.
  bool take_answer();

  /// Whether an answer has not been taken yet.
  [[nodiscard]] bool is_busy() const { return answer_.is_begun(); }

  /// Pins the line of sight at a position in the window.
  void pin(const dvec2& position);
  void unpin() { pin_.reset(), end_.reset(); }
  [[nodiscard]] bool has_pin() const { return pin_.has_value(); }

  /// Sets a second pin, where a line from the first one ends. Without a pin, it is the first.
  void pin_end(const dvec2& position);

  /// Returns the positions of two pins, once.
  [[nodiscard]] std::optional<std::array<dvec3, 2>> take_ends();

  /// Lets go of the session's splats, and of the pin.
  void end();

  /// Draws values and pins. Answers come from a job, and only at rest: while the picture changes, nobody holds its
  /// splats, and nobody waits for its values. `over_picture`: the pointer is not over a control. `has_plot`: the pin
  /// has a window.
  void draw(bool is_at_rest, bool over_picture, bool has_plot);

 private:
  struct Question {
    Looking looking;
    Scene scene;           // without its camera and size
    std::size_t step = 0;  // of a series
    bool of_cells = false;
    std::uint64_t serial = 0;            // FrameSplats::serial, of splats
    std::optional<double> opacity = {};  // as in PickedSplats::follow

    [[nodiscard]] bool operator==(const Question&) const = default;
  };
  struct Answer {
    std::shared_ptr<const PickedSplats> splats = {};  // that were asked
    std::optional<Pick> pick = {};                    // none: the ray meets nothing
    std::optional<Error> trouble = {};                // why it is not known
  };
  // A line of sight that was clicked on.
  struct Pin {
    Looking looking;
    std::optional<Question> asked = {};  // the question that `pick` answers
    std::optional<Pick> pick = {};
  };
  [[nodiscard]] Looking looking_at(const dvec2& position) const;
  [[nodiscard]] std::optional<Question> question_about(const Looking& looking) const;
  [[nodiscard]] std::optional<double> opacity_of(const Looking& looking) const;
  void ask(const Question& question);
  void ask_cells(const Question& question);
  void ask_splats(const Question& question);
  [[nodiscard]] const std::optional<Pick>* answer_to(const Question& question) const;
  void forget();
  void look_at(std::optional<Pin>& pin);
  [[nodiscard]] bool is_wanted(const Question& asked, const std::optional<Question>& hovered) const;
  void draw_hovered(const Question& question);
  void draw_ring() const;
  void draw_pinned();

  ViewerState& viewer_;
  std::optional<Pin> pin_, end_;
  std::optional<Question> asked_;  // that the job answers
  std::optional<Question> answered_;
  Answer last_;  // to it; its splats serve other questions about the frame
  Task<Answer> answer_;
};

}  // namespace splatvol
