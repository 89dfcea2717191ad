// The panel's controls of movies: of a turn, or of the camera path.
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

  /// A movie whose frames are drawn, and then joined by a job.
  struct Filming {
    Movie movie;
    std::string path;
    SaveSection::Layout layout;
    int frames, drawn;
    bool turns;
    Camera first;
    Task<Status> joined = {};
  };
  [[nodiscard]] const std::optional<Filming>& filming() const { return filming_; }

  /// Keeps the frame that is there, and looks from the place of the next one.
  void film();

  /// Gives up a movie that is not complete; if its frames are being joined, only if `waits`.
  void end(bool waits);

  /// Whether there is a movie that `end` gives up at once.
  [[nodiscard]] bool can_end() const { return filming_ && !filming_->joined.is_begun(); }

  /// Draws the toast that tells how far it is.
  void draw_progress();

  /// Sets the name of the file, without its ending.
  void begin(const std::string& stem) { name_.set(stem + ".mp4"); }

 private:
  void save_movie();

  ViewerState& viewer_;
  SaveSection& save_;
  const PathSection& path_;
  std::optional<Filming> filming_;
  TextField name_;
  bool films_path_ = false;
  double frames_per_second_ = 30;
};

}  // namespace splatvol
