// The panel's part "line": values between two places, and at one place over the steps of a series.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pictures/plot.h"
#include "player/line_values.h"
#include "viewer/save_section.h"
#include "viewer/state.h"

namespace splatvol {

/// Jobs read the values. The line is drawn over the picture, its plot in a window.
class LineSection {
 public:
  LineSection(ViewerState& viewer, SaveSection& save) : viewer_(viewer), save_(save) {}

  /// Draws the controls.
  void draw();

  /// Shows the line between two positions.
  void show(const std::array<dvec3, 2>& ends);
  void hide() { is_shown_ = false; }
  [[nodiscard]] bool is_shown() const { return is_shown_; }

  /// Ends the plot over steps, and what is read for it.
  void end_steps();
  [[nodiscard]] bool has_steps() const { return reading_steps_.is_begun() || !over_steps_.curves.empty(); }

  /// Takes what jobs have read; false: nothing. Called in each frame.
  bool take_answers();
  [[nodiscard]] bool is_busy() const { return reading_.is_begun() || lighting_.is_begun(); }

  /// Whether longer jobs are at work.
  [[nodiscard]] bool has_jobs() const { return reading_steps_.is_begun() || saving_.is_begun(); }

  /// Draws the line and the plots, and asks for what they lack. `is_at_rest`: the picture is not about to change. The
  /// part of the line that something hides is faint, where cells tell it. `over_picture`: the pointer is not over a
  /// control.
  void draw_line(bool is_at_rest, bool over_picture);

  /// Sets the names of files, without their endings, and a line across the mesh that is not shown.
  void begin(const std::string& stem);
  void end();

 private:
  // Which parts of the line are seen in a view.
  struct Seen {
    LineRequest line;
    View view = {};
    Scene scene = {};
    std::vector<double> lights = {};  // [place]: as light_from

    [[nodiscard]] bool is_of(const Seen& other) const {
      return line == other.line && view == other.view && scene == other.scene;
    }
  };
  [[nodiscard]] LineRequest request() const;
  [[nodiscard]] std::vector<dvec3> places() const;
  [[nodiscard]] bool has_rows() const { return is_shown_ && rows_ && !rows_->arc_lengths.empty(); }
  void draw_ends();
  void draw_attributes();
  void draw_saving(const std::string& why_not);
  void draw_steps(const std::string& attribute);
  void save_table(const std::string& path);
  void save_picture(const std::string& path);
  void read_over_steps(const std::string& attribute);
  void ask_rows();
  void ask_lights();
  void update_plot();
  [[nodiscard]] std::optional<double> cursor_in_picture() const;
  void draw_in_picture() const;
  void draw_cursor() const;
  void draw_window();
  void draw_values_at(double arc_length) const;
  void draw_steps_window();

  ViewerState& viewer_;
  SaveSection& save_;
  bool is_shown_ = false;
  std::array<dvec3, 2> ends_{};
  std::vector<std::string> attributes_;
  bool has_common_axis_ = false;
  TextField table_name_, picture_name_;

  std::optional<LineRequest> asked_, answered_;
  Task<Result<LineRows>> reading_;
  std::optional<LineRows> rows_;  // of answered_
  CurvePlot plot_;                // of these rows
  std::string trouble_;           // why there are none
  std::optional<double> cursor_;  // an arc length that plot and picture mark

  Seen seen_, asked_seen_;
  Task<Result<std::vector<double>>> lighting_;

  Task<Result<std::vector<double>>> reading_steps_;
  std::shared_ptr<std::atomic<std::size_t>> steps_done_;
  dvec3 place_of_steps_{0};
  CurvePlot over_steps_;  // with a curve, once it is there

  Task<Status> saving_;
  std::string saved_;  // the path of the table that is being written
};

}  // namespace splatvol
