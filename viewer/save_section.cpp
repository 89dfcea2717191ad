#include "viewer/save_section.h"

#include <fmt/format.h>
#include <imgui.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <utility>

#include "base/file.h"
#include "base/program.h"
#include "base/replaceable.h"
#include "pictures/contrast.h"
#include "viewer/page_of.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr int largest_picture = 16384;

Status write_json(const std::string& path, const std::string& text) {
  if (!has_extension(path, ".json")) return fail(ErrorCode::invalid_argument, "{}: does not end in .json", path);
  return write_text_file(path, text);
}

// Returns a word for a shell.
std::string quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

// The file of a scene is named from the scene's folder on, if it lies there: both can be moved.
std::string scene_text(const std::string& path, const Session& session) {
  UsedScene used = session.used_scene();
  std::error_code error;
  const auto folder = std::filesystem::absolute(path, error).parent_path().lexically_normal();
  const auto make_relative = [&](std::string& file) {
    const auto relative = std::filesystem::path(file).lexically_relative(folder);
    if (!is_url(file) && !relative.empty() && *relative.begin() != "..") file = relative.string();
  };
  make_relative(used.use.file);
  std::ranges::for_each(used.use.pieces, make_relative);
  return to_json(used);
}

// Puts a .png into the desktop's clipboard. GLFW holds text only, so a program has to.
Status copy_png(const std::string& path) {
  const bool is_wayland = std::getenv("WAYLAND_DISPLAY") != nullptr;
  const int code = is_wayland ? run_program({"wl-copy", "--type", "image/png"}, {.input = path})
                              : run_program({"xclip", "-selection", "clipboard", "-t", "image/png", "-i", path});
  const char* program = is_wayland ? "wl-copy (package wl-clipboard)" : "xclip";
  if (code == no_program) return fail(ErrorCode::io, "no {} in PATH: install it, or save the picture", program);
  return code == 0 ? Status{} : fail(ErrorCode::io, "{} failed: save the picture", program);
}

}  // namespace

void TextField::draw(const char* name) { ImGui::InputText(name, text_.data(), text_.size()); }

void SaveSection::begin(const std::string& stem) {
  scene_name_.set(stem + ".json");
  picture_name_.set(stem + ".png");
}

std::optional<std::string> SaveSection::draw() {
  std::optional<std::string> opened;
  scene_name_.draw("scene");
  if (ImGui::SmallButton("save scene")) save_json(scene_name_.text(), scene_text(scene_name_.text(), *viewer_.session));
  ImGui::SameLine();
  if (ImGui::SmallButton("load scene or colours")) opened = scene_name_.text();
  if (ImGui::SmallButton("copy command")) copy_command();
  hint("Copies a command that shows the same: file, scene, step, detail and kernel (control C)");
  draw_picture_controls();
  return opened;
}

void SaveSection::copy_command() {
  UsedScene used = viewer_.session->used_scene();
  std::string files = quoted(std::exchange(used.use.file, ""));
  for (const std::string& piece : std::exchange(used.use.pieces, {})) files += " " + quoted(piece);
  ImGui::SetClipboardText(fmt::format("svview {} --scene {}", files, quoted(to_json(used, -1))).c_str());
  viewer_.messages.note("copied a command");
}

// The same page as svrender's.
void SaveSection::draw_picture_controls() {
  Scene& scene = viewer_.session->scene;
  int light = is_light(scene.background) ? 1 : 0;
  if (ImGui::Combo("background", &light, "dark\0white\0")) adapt_to_background(scene, dvec3(light));
  title_.draw("title");
  if (viewer_.session->times().size() > 1) ImGui::Checkbox("time in the file", &saves_time_);
  ImGui::Checkbox("scalar bar in the file", &saves_bar_);
  ImGui::SameLine();
  ImGui::Checkbox("transparent", &saves_transparent_);
  draw_scalar_bar_controls();
  picture_name_.draw("picture");
  ImGui::Checkbox("size as shown", &saves_as_shown_);
  if (!saves_as_shown_) ImGui::InputInt2("size", saved_size_.data());
  if (ImGui::SmallButton("save picture (.png, .exr)")) save_picture();
  ImGui::SameLine();
  if (ImGui::SmallButton("copy picture")) copy_picture();
  hint("To the clipboard, by xclip or wl-copy");
}

// In one line: the unit, and the number of ticks.
void SaveSection::draw_scalar_bar_controls() {
  ScalarBar& bar = viewer_.session->scene.scalar_bar;
  const float scale = viewer_.scale();
  std::array<char, 64> unit{};
  bar.unit.copy(unit.data(), unit.size() - 1);
  ImGui::SetNextItemWidth(90 * scale);
  if (ImGui::InputText("unit", unit.data(), unit.size())) bar.unit = unit.data();
  hint("In place of the attribute's");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(86 * scale);
  ImGui::SliderInt("ticks", &bar.ticks, 2, 20, "%d", ImGuiSliderFlags_AlwaysClamp);
}

void SaveSection::save(const std::string& path, std::function<void()> write) {
  std::error_code error;
  if (std::filesystem::exists(path, error))
    question_ = Question{path, std::move(write)};
  else
    write();
}

void SaveSection::save_json(const std::string& path, const std::string& text) {
  save(path, [=, this] { viewer_.messages.tell(write_json(path, text), "saved " + path); });
}

void SaveSection::save_picture() {
  const std::string path = picture_name_.text();
  if (!is_image_path(path)) {
    viewer_.messages.error(path + ": neither .png nor .exr: give it another ending");
  } else if (const auto laid_out = layout(path)) {
    save(path, [=, this] { saving_ = Saving{path, *laid_out}; });
  }
}

std::optional<SaveSection::Layout> SaveSection::layout(const std::string& path) {
  auto laid_out = lay_out(path);
  if (laid_out) return std::move(*laid_out);
  viewer_.messages.error(laid_out.error().message);
  return {};
}

// The size is that of the file, as in svrender. An .exr has no words.
Result<SaveSection::Layout> SaveSection::lay_out(const std::string& path) const {
  const Session& session = *viewer_.session;
  const std::array<int, 2> size = saves_as_shown_ ? std::array{session.scene.width, session.scene.height} : saved_size_;
  if (std::ranges::min(size) < 1 || std::ranges::max(size) > largest_picture)
    return fail(ErrorCode::invalid_argument, "{} x {}: sides of pictures have 1 to {} pixels", size[0], size[1],
                largest_picture);
  Layout layout{.page = {}, .text = {}, .is_transparent = saves_transparent_};
  if (!has_extension(path, ".exr")) {
    layout.text.title = title_.text();
    const std::vector<double>& times = session.times();
    if (saves_time_ && times.size() > 1) layout.text.title = title_with_time(layout.text.title, times[session.step()]);
    if (saves_bar_) layout.text.bars = session.scalar_bars();
    layout.text.ticks = session.scene.scalar_bar.ticks;
  }
  SPLATVOL_TRY_SET(layout.page, lay_out_page(size[0], size[1], layout.text));
  return layout;
}

void SaveSection::save_drawn_picture() {
  if (!saving_ || (viewer_.drawn && !viewer_.session->is_settled())) return;
  const Status written = viewer_.drawn ? write_picture(saving_->path, saving_->layout) : viewer_.drawn;
  if (saving_->is_copied) {
    const Status copied = written ? copy_png(saving_->path) : written;
    viewer_.messages.tell(copied, "copied the picture");
    std::error_code error;
    std::filesystem::remove(saving_->path, error);
  } else {
    viewer_.messages.tell(written, "saved " + saving_->path);
  }
  saving_.reset();
}

void SaveSection::copy_picture() {
  std::error_code error;
  const std::string folder = std::filesystem::temp_directory_path(error).string();
  const std::string path = fmt::format("{}/svview-{}.png", error ? "/tmp" : folder, ::getpid());
  if (const auto laid_out = layout(path)) saving_ = Saving{path, *laid_out, true};
}

void SaveSection::draw_question() {
  if (!question_) return;
  constexpr const char* name = "replace?";
  ImGui::OpenPopup(name);
  ImGui::SetNextWindowPos({static_cast<float>(viewer_.window.width) / 2, static_cast<float>(viewer_.window.height) / 2},
                          ImGuiCond_Always, {0.5f, 0.5f});
  if (!ImGui::BeginPopupModal(name, nullptr, ImGuiWindowFlags_AlwaysAutoResize)) return;
  ImGui::Text("%s is there.", question_->path.c_str());
  const bool replaces = ImGui::Button("replace it");
  ImGui::SameLine();
  if (replaces || ImGui::Button("keep it") || question_->is_kept) {
    ImGui::CloseCurrentPopup();
    if (replaces) question_->write();
    question_.reset();
  }
  ImGui::EndPopup();
}

Status SaveSection::write_picture(const std::string& path, const Layout& layout) const {
  const Session& session = *viewer_.session;
  const bool transparent = layout.is_transparent;
  SPLATVOL_TRY_ASSIGN(
      image, has_extension(path, ".exr") ? session.image() : page_of(session, layout.page, layout.text, transparent));
  return write_image(path, image, session.scene.background,
                     {{"software", "svview"}, {"file", session.path()}, {"attribute", session.scene.attribute}},
                     transparent);
}

}  // namespace splatvol
