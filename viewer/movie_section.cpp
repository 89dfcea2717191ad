#include "viewer/movie_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "player/camera_motion.h"

namespace splatvol {

void MovieSection::draw() {
  int of = films_path_ ? 1 : 0;
  if (ImGui::Combo("movie of", &of, "a turn\0the path\0")) films_path_ = of == 1;
  const double slowest = 1, fastest = 120;
  ImGui::SliderScalar("frames/s", ImGuiDataType_Double, &frames_per_second_, &slowest, &fastest, "%.3g",
                      ImGuiSliderFlags_AlwaysClamp);
  name_.draw("file##movie");
  ImGui::BeginDisabled(filming_ || save_.saving() || (films_path_ && path_.path().views.size() < 2));
  if (ImGui::SmallButton("save movie (.mp4)")) save_movie();
  ImGui::EndDisabled();
  if (ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled))
    ImGui::SetTooltip(
        "Each frame is as fine as the picture at rest. Size, title and scalar bar: as in \"save\".\n"
        "A path needs two views.");
}

void MovieSection::save_movie() {
  const std::string path = name_.text();
  if (const std::string wrong = check_movie_path(path); !wrong.empty()) {
    viewer_.messages.error(wrong);
    return;
  }
  const auto layout = save_.layout(path);
  if (!layout) return;
  save_.save(path, [=, this] {
    auto movie = Movie::create(path, "", frames_per_second_);
    if (!movie) {
      viewer_.messages.error(movie.error().message);
      return;
    }
    const int frames = std::max(1, static_cast<int>(std::lround(path_.path().seconds * frames_per_second_)));
    filming_.emplace(Filming{std::move(*movie), path, *layout, frames, 0, !films_path_, viewer_.session->scene.camera});
    film();
  });
}

void MovieSection::film() {
  if (!filming_) return;
  Filming& film = *filming_;
  if (film.joined.is_begun()) {
    if (!film.joined.wait()) return;
    viewer_.messages.tell(film.joined.take(), "saved " + film.path);
    filming_.reset();
    return;
  }
  Camera& camera = viewer_.session->scene.camera;
  const auto camera_of = [&](int frame) {
    if (film.turns) return camera_at(film.first, CameraMotion{film.frames}, frame);
    return camera_at(path_.path(), film.frames > 1 ? static_cast<double>(frame) / (film.frames - 1) : 0);
  };
  const Scene& scene = viewer_.session->scene;
  const Page& page = film.layout.page;
  const bool is_there = viewer_.drawn && viewer_.session->is_settled() && camera == camera_of(film.drawn) &&
                        scene.width == page.picture_width && scene.height == page.picture_height;
  if (is_there || !viewer_.drawn) {
    const Status written =
        viewer_.drawn ? save_.write_picture(film.movie.frame_path(film.drawn), film.layout) : viewer_.drawn;
    if (!written) {
      viewer_.messages.error(written.error().message);
      return end(true);
    }
    if (++film.drawn == film.frames) {
      camera = film.first;
      film.joined = {viewer_.host, [movie = film.movie, frames = film.frames] { return movie.finish(0, frames); }};
      return;
    }
  }
  camera = camera_of(film.drawn);
}

void MovieSection::end(bool waits) {
  if (!filming_ || (!waits && filming_->joined.is_begun())) return;
  if (viewer_.session) viewer_.session->scene.camera = filming_->first;
  if (!filming_->joined.is_begun()) filming_->movie.discard(0, filming_->drawn);
  filming_.reset();  // waits for ffmpeg, if the frames are being joined
}

void MovieSection::draw_progress() {
  if (!filming_) return;
  Messages::Work work{.name = "movie",
                      .text = fmt::format("{}: ffmpeg joins {} frames", filming_->path, filming_->frames)};
  if (can_end()) {
    work.text = fmt::format("{}: frame {} of {}", filming_->path, filming_->drawn + 1, filming_->frames);
    work.buttons = {"stop (Esc)"};
    work.share = static_cast<double>(filming_->drawn) / filming_->frames;
  }
  if (viewer_.messages.draw(work)) end(true);
}

}  // namespace splatvol
