// Movies from the window: of a turn, or of the camera path.
#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "player/camera_motion.h"
#include "viewer/viewer.h"

namespace splatvol {

void Viewer::draw_movie_controls() {
  int of = films_path_ ? 1 : 0;
  if (ImGui::Combo("movie of", &of, "a turn\0the path\0")) films_path_ = of == 1;
  const double slowest = 1, fastest = 120;
  ImGui::SliderScalar("frames/s", ImGuiDataType_Double, &frames_per_second_, &slowest, &fastest, "%.3g",
                      ImGuiSliderFlags_AlwaysClamp);
  ImGui::InputText("file##movie", movie_name_.data(), movie_name_.size());
  ImGui::BeginDisabled(filming_ || saving_ || (films_path_ && path_.cameras.size() < 2));
  if (ImGui::SmallButton("save movie (.mp4)")) save_movie();
  ImGui::EndDisabled();
  if (ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled))
    ImGui::SetTooltip(
        "Each frame is as fine as the picture at rest. Size, title and scalar bar: as in \"save\".\n"
        "A path needs two views.");
}

void Viewer::save_movie() {
  const std::string path = movie_name_.data();
  if (const std::string wrong = check_movie_path(path); !wrong.empty()) {
    message_ = wrong;
    return;
  }
  const auto size = saved_size();
  if (!size) return;
  save(path, [=, this] {
    auto movie = Movie::create(path, "", frames_per_second_);
    if (!movie) {
      message_ = movie.error().message;
      return;
    }
    stop_playing();
    const int frames = std::max(1, static_cast<int>(std::lround(path_.seconds * frames_per_second_)));
    filming_.emplace(
        Filming{std::move(*movie), path, (*size)[0], (*size)[1], frames, 0, !films_path_, session_->scene.camera});
    film();
  });
}

// Keeps the frame that is there, and looks from the place of the next one.
void Viewer::film() {
  if (!filming_) return;
  Filming& film = *filming_;
  if (film.joined.valid()) {
    if (film.joined.wait_for(std::chrono::seconds(0)) == std::future_status::timeout) return;
    report(film.path, film.joined.get());
    filming_.reset();
    return;
  }
  Camera& camera = session_->scene.camera;
  const auto camera_of = [&](int frame) {
    if (film.turns) return camera_at(film.first, CameraMotion{film.frames}, frame);
    return camera_at(path_, film.frames > 1 ? static_cast<double>(frame) / (film.frames - 1) : 0);
  };
  const bool is_there = drawn_ && session_->is_settled() && camera == camera_of(film.drawn) &&
                        session_->scene.width == film.width && session_->scene.height == film.height;
  if (is_there || !drawn_) {
    const Status written = drawn_ ? write_picture(film.movie.frame_path(film.drawn)) : drawn_;
    if (!written) {
      message_ = written.error().message;
      return end_film();
    }
    if (++film.drawn == film.frames) {
      camera = film.first;
      film.joined = std::async(std::launch::async | std::launch::deferred,
                               [movie = film.movie, frames = film.frames] { return movie.finish(0, frames); });
      return;
    }
  }
  camera = camera_of(film.drawn);
}

// Gives up a movie that is not complete.
void Viewer::end_film() {
  if (!filming_) return;
  if (session_) session_->scene.camera = filming_->first;
  if (!filming_->joined.valid()) filming_->movie.discard(0, filming_->drawn);
  filming_.reset();  // waits for ffmpeg, if the frames are being joined
}

// Tells what the picture is drawn for.
void Viewer::draw_work() {
  if (saving_) return draw_message(fmt::format("{} is being drawn", saving_->path), picture_area());
  const PictureArea area = picture_area();
  ImGui::SetNextWindowPos({static_cast<float>(area.left + area.width / 2), static_cast<float>(area.height / 2)},
                          ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::Begin("movie", nullptr, ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize);
  if (filming_->joined.valid()) {
    ImGui::TextUnformatted(fmt::format("{}: ffmpeg joins {} frames", filming_->path, filming_->frames).c_str());
  } else {
    ImGui::TextUnformatted(
        fmt::format("{}: frame {} of {}", filming_->path, filming_->drawn + 1, filming_->frames).c_str());
    if (ImGui::SmallButton("stop (Esc)")) end_film();
  }
  ImGui::End();
}

}  // namespace splatvol
