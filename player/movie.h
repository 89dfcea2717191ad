// Numbered frames in a folder, and a movie of them by ffmpeg.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// For CLI11: refuses a movie's path that does not end in .mp4.
[[nodiscard]] std::string check_movie_path(const std::string& path);

/// The frames of a movie on their way. Frames are PNG files, written by the caller.
class Movie {
 public:
  /// `movie`: the .mp4 to write; empty: frames only. `folder`: where the frames go, which is made if it is not there;
  /// empty: into MOVIE.frames, which must not exist, and is removed when the movie is done or a signal ends the
  /// program.
  [[nodiscard]] static Result<Movie> create(const std::string& movie, const std::string& folder,
                                            double frames_per_second);

  /// Returns the path of a frame, with its number.
  [[nodiscard]] std::string frame_path(int number) const;

  /// Joins `count` frames, beginning with the frame `first`, with the ffmpeg that PATH finds. The movie appears whole
  /// or not at all. Fails if there is no ffmpeg or it fails: the message tells where the frames are, which stay. Does
  /// nothing without a movie.
  [[nodiscard]] Status finish(int first, int count) const;

  /// Removes `count` frames, beginning with the frame `first`, and a folder that was made for them: no movie is wanted.
  void discard(int first, int count) const;

 private:
  Movie(std::string movie, std::string folder, double frames_per_second, bool own_folder);
  std::string movie_, folder_;
  double frames_per_second_;
  bool own_folder_;
};

}  // namespace splatvol
