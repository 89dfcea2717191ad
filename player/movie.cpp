#include "player/movie.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/program.h"
#include "base/temporary_names.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

std::string last_line(const std::string& path) {
  const auto text = read_text_file(path);
  if (!text) return {};
  const std::size_t end = text->find_last_not_of(" \r\n");
  if (end == std::string::npos) return {};
  const std::size_t begin = text->find_last_of("\r\n", end);
  return text->substr(begin == std::string::npos ? 0 : begin + 1,
                      end - (begin == std::string::npos ? 0 : begin + 1) + 1);
}

}  // namespace

std::string check_movie_path(const std::string& path) {
  return path.size() > 4 && path.ends_with(".mp4") ? "" : "'" + path + "' does not end in .mp4";
}

Movie::Movie(std::string movie, std::string folder, double frames_per_second, bool own_folder)
    : movie_(std::move(movie)),
      folder_(std::move(folder)),
      frames_per_second_(frames_per_second),
      own_folder_(own_folder) {}

Result<Movie> Movie::create(const std::string& movie, const std::string& folder, double frames_per_second) {
  std::error_code error;
  if (!folder.empty() || movie.empty()) {
    SPLATVOL_TRY(make_folder(folder));
    return Movie(movie, folder, frames_per_second, false);
  }
  std::string own = movie + ".frames";
  if (!fs::create_directory(own, error))
    return fail(ErrorCode::io, "{}: {}; frames need a new folder, or --progress-frames DIR", own,
                error ? error.message() : "is there already");
  note_temporary(own);
  return Movie(movie, std::move(own), frames_per_second, true);
}

std::string Movie::frame_path(int number) const { return fmt::format("{}/frame-{:04}.png", folder_, number); }

Status Movie::finish(int first, int count) const {
  if (movie_.empty()) return {};
  const std::string part = movie_ + ".part", log = folder_ + "/ffmpeg.log", frames = folder_ + "/frame-%04d.png";
  const std::string rate = fmt::format("{}", frames_per_second_);
  note_temporary(part);
  // Players want sides of even length and colours that are halved; the last row or column is repeated if need be.
  const int code =
      run_program({"ffmpeg", "-y", "-loglevel", "error", "-framerate", rate, "-start_number", fmt::format("{}", first),
                   "-i", frames, "-frames:v", fmt::format("{}", count), "-vf",
                   "pad=ceil(iw/2)*2:ceil(ih/2)*2,format=yuv420p", "-movflags", "+faststart", "-f", "mp4", part},
                  {.log = log});
  forget_temporary(part);
  std::error_code error;
  if (code != 0) {
    if (own_folder_) forget_temporary(folder_);
    const std::string words = last_line(log);
    fs::remove(part, error);
    fs::remove(log, error);
    if (code == no_program)
      return fail(ErrorCode::io,
                  "{}: no ffmpeg in PATH: the {} frames are in {}; install it, then: ffmpeg -framerate {} "
                  "-start_number {} -i {} {}",
                  movie_, count, folder_, rate, first, frames, movie_);
    return fail(ErrorCode::io, "{}: ffmpeg failed ({}); the {} frames are in {}", movie_, words, count, folder_);
  }
  fs::rename(part, movie_, error);
  if (error) return fail(ErrorCode::io, "{}: {}; the finished movie is {}", movie_, error.message(), part);
  fs::remove(log, error);
  if (own_folder_) discard(first, count);
  return {};
}

void Movie::discard(int first, int count) const {
  std::error_code error;
  for (int i = 0; i < count; ++i) fs::remove(frame_path(first + i), error);
  if (!own_folder_) return;
  fs::remove(folder_, error);
  forget_temporary(folder_);
}

}  // namespace splatvol
