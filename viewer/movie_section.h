// The panel's controls of movies: of a turn, of the camera path, or of the steps of a series.
#pragma once

#include <optional>
#include <string>

#include "player/movie.h"
#include "viewer/path_section.h"
#include "viewer/save_section.h"
#include "viewer/state.h"

namespace splatvol {

class MovieSection {
 public:
  MovieSection(ViewerState& viewer, SaveSection& save, const PathSection& path)
      : viewer_(viewer), save_(save), path_(path) {}

  void draw();

  /// What a movie shows. Steps are numbered as in the file; both ends are in it.
  struct Contents {
    enum class Of { turn, path, steps };
    Of of = Of::turn;
    std::size_t first_step = 0, last_step = 0;
    int frames_of_step = 1;
  };

  /// Where a frame is drawn from, and of which step.
  struct Place {
    Camera camera;
    std::size_t step;

    [[nodiscard]] bool operator==(const Place&) const = default;
  };

  /// A movie whose frames are drawn, and then joined by a job.
  struct Filming {
    Movie movie;
    std::string path;
    SaveSection::Layout layout;
    Contents contents;
    int frames, drawn;
    Place before;                                // the movie
    std::optional<std::size_t> asked_step = {};  // for a frame
    Task<Status> joined = {};
  };
  [[nodiscard]] const std::optional<Filming>& filming() const { return filming_; }

  /// Keeps the frame that is there, and goes to the place of the next one. Ends the movie where a step cannot be read.
  void film();

  /// Gives up a movie that is not complete; if its frames are being joined, only if `waits`.
  void end(bool waits);

  /// Whether there is a movie that `end` gives up at once.
  [[nodiscard]] bool can_end() const { return filming_ && !filming_->joined.is_begun(); }

  /// Draws the toast that tells how far it is.
  void draw_progress();

  /// Sets the name of the file, without its ending.
  void begin(const std::string& stem);

 private:
  void draw_steps();
  void save_movie();
  [[nodiscard]] int frame_count() const;
  [[nodiscard]] Place place_of(const Filming& film) const;
  [[nodiscard]] bool is_drawn(const Filming& film) const;
  void go_to_frame(Filming& film);
  void go_back();

  ViewerState& viewer_;
  SaveSection& save_;
  const PathSection& path_;
  std::optional<Filming> filming_;
  TextField name_;
  Contents contents_;
  double frames_per_second_ = 30;
};

}  // namespace splatvol
