#include "viewer/movie_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "player/camera_motion.h"
#include "viewer/window/gui_units.h"

namespace splatvol {

void MovieSection::begin(const std::string& stem) {
  name_.set(stem + ".mp4");
  contents_ = {.last_step = std::max<std::size_t>(viewer_.session->times().size(), 1) - 1};
}

// Which steps, and how many frames show each of them.
void MovieSection::draw_steps() {
  const std::vector<double>& times = viewer_.session->times();
  const std::size_t first = 0, last = times.size() - 1;
  const auto draw_step = [&](const char* label, std::size_t& step) {
    const std::string text = fmt::format("%llu (time {:g})", times[step]);
    ImGui::SliderScalar(label, ImGuiDataType_U64, &step, &first, &last, text.c_str(), ImGuiSliderFlags_AlwaysClamp);
  };
  draw_step("from", contents_.first_step);
  draw_step("to", contents_.last_step);
  const int least = 1, most = 120;
  ImGui::SliderScalar("frames each", ImGuiDataType_S32, &contents_.frames_of_step, &least, &most, "%d",
                      ImGuiSliderFlags_AlwaysClamp);
}

void MovieSection::draw() {
  const bool has_steps = viewer_.session->times().size() > 1;
  int of = static_cast<int>(contents_.of);
  if (ImGui::Combo("movie of", &of, has_steps ? "a turn\0the path\0the steps\0" : "a turn\0the path\0"))
    contents_.of = static_cast<Contents::Of>(of);
  if (contents_.of == Contents::Of::steps) draw_steps();
  const double slowest = 1, fastest = 120;
  ImGui::SliderScalar("frames/s", ImGuiDataType_Double, &frames_per_second_, &slowest, &fastest, "%.3g",
                      ImGuiSliderFlags_AlwaysClamp);
  name_.draw("file##movie");
  ImGui::BeginDisabled(filming_ || save_.saving() || frame_count() == 0);
  if (ImGui::SmallButton("save movie (.mp4)")) save_movie();
  ImGui::EndDisabled();
  hint(
      "Each frame is as fine as the picture at rest. Size, title and scalar bar: as in \"save\".\n"
      "A path needs two views. Steps run from a number to the same or a larger one.");
}

// 0: there is no such movie.
int MovieSection::frame_count() const {
  if (contents_.of == Contents::Of::steps) {
    if (contents_.first_step > contents_.last_step) return 0;
    return contents_.frames_of_step * static_cast<int>(contents_.last_step - contents_.first_step + 1);
  }
  if (contents_.of == Contents::Of::path && path_.path().views.size() < 2) return 0;
  return std::max(1, static_cast<int>(std::lround(path_.path().seconds * frames_per_second_)));
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
    Session& session = *viewer_.session;
    session.stop_playing();
    filming_.emplace(Filming{std::move(*movie), path, *layout, contents_, frame_count(), 0,
                             Place{session.scene.camera, session.step()}});
    film();
  });
}

// Of the frame that is drawn next.
MovieSection::Place MovieSection::place_of(const Filming& film) const {
  if (film.contents.of == Contents::Of::turn)
    return {camera_at(film.before.camera, CameraMotion{film.frames}, film.drawn), film.before.step};
  if (film.contents.of == Contents::Of::steps)
    return {film.before.camera,
            film.contents.first_step + static_cast<std::size_t>(film.drawn / film.contents.frames_of_step)};
  const double share = film.frames > 1 ? static_cast<double>(film.drawn) / (film.frames - 1) : 0;
  return {camera_at(path_.path(), share), film.before.step};
}

bool MovieSection::is_drawn(const Filming& film) const {
  const Session& session = *viewer_.session;
  const Page& page = film.layout.page;
  return session.is_settled() && Place{session.scene.camera, session.step()} == place_of(film) &&
         session.scene.width == page.picture_width && session.scene.height == page.picture_height;
}

// A step that was asked for and is not there cannot be read: the session tells why.
void MovieSection::go_to_frame(Filming& film) {
  Session& session = *viewer_.session;
  const auto [camera, step] = place_of(film);
  session.scene.camera = camera;
  if (step == session.step()) return;
  if (film.asked_step == step) return end(true);
  film.asked_step = step;
  session.ask_step(step);
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
  if (!viewer_.drawn || is_drawn(film)) {
    const Status written =
        viewer_.drawn ? save_.write_picture(film.movie.frame_path(film.drawn), film.layout) : viewer_.drawn;
    if (!written) {
      viewer_.messages.error(written.error().message);
      return end(true);
    }
    if (++film.drawn == film.frames) {
      go_back();
      film.joined = {viewer_.host, [movie = film.movie, frames = film.frames] { return movie.finish(0, frames); }};
      return;
    }
  }
  go_to_frame(film);
}

void MovieSection::go_back() {
  if (!viewer_.session) return;
  const auto [camera, step] = filming_->before;
  viewer_.session->scene.camera = camera;
  if (step != viewer_.session->step()) viewer_.session->ask_step(step);
}

void MovieSection::end(bool waits) {
  if (!filming_ || (!waits && filming_->joined.is_begun())) return;
  if (!filming_->joined.is_begun()) go_back(), filming_->movie.discard(0, filming_->drawn);
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
