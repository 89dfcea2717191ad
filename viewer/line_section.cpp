#include "viewer/line_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <utility>

#include "base/replaceable.h"
#include "format/splat_reader.h"
#include "sampler/line_export.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr int picture_width = 1280, picture_height = 800;

// Returns a name with its unit.
std::string label_of(const Session& session, const std::string& name) {
  const auto& all = session.info().attributes;
  const auto found = std::ranges::find(all, name, &format::Attribute::name);
  return found == all.end() || found->unit.empty() ? name : fmt::format("{} ({})", name, found->unit);
}

// Of the clip region and the camera, the view tells.
Scene without_camera(Scene scene) {
  scene.camera = {};
  return scene;
}

bool draw_button(const char* name, const std::string& why_not) {
  ImGui::BeginDisabled(!why_not.empty());
  const bool is_pressed = ImGui::SmallButton(name);
  ImGui::EndDisabled();
  return is_pressed;
}

Status save_line(const format::Steps& steps, const LineRequest& line, const std::string& path) {
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(line.step));
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(*volume, {}, line.attributes, format::SplatSelection().box));
  SPLATVOL_TRY(export_line(*volume, path, selection, line.start, line.end, {}, Replace::any));
  return {};
}

}  // namespace

void LineSection::begin(const std::string& stem) {
  const Session& session = *viewer_.session;
  table_name_.set(stem + "-line.csv");
  picture_name_.set(stem + "-line.png");
  ends_ = {session.mesh_box().low, session.mesh_box().high};
  attributes_ = {session.scene.attribute};
}

void LineSection::end() {
  hide();
  end_steps();
  reading_.end();
  lighting_.end();
  saving_.end();
  asked_.reset();
  answered_.reset();
  rows_.reset();
  trouble_.clear();
  cursor_.reset();
  seen_ = asked_seen_ = {};
}

void LineSection::end_steps() {
  reading_steps_.end();
  over_steps_ = {};
}

void LineSection::show(const std::array<dvec3, 2>& ends) {
  ends_ = ends;
  const std::string why_not = why_no_line(viewer_.session->info().cells.has_value(), request());
  is_shown_ = why_not.empty();
  if (!is_shown_) viewer_.messages.note(why_not);
}

LineRequest LineSection::request() const { return {ends_[0], ends_[1], attributes_, viewer_.session->step()}; }

void LineSection::draw() {
  const Session& session = *viewer_.session;
  const std::string why_not = why_no_line(session.info().cells.has_value(), request());
  draw_ends();
  draw_attributes();
  ImGui::BeginDisabled(!why_not.empty());
  ImGui::Checkbox("show line", &is_shown_);
  ImGui::EndDisabled();
  hint("Or click on a place, and then with shift on another one.");
  ImGui::SameLine();
  ImGui::Checkbox("common axis", &has_common_axis_);
  ImGui::Text("length %.6g", request().length());
  if (!why_not.empty()) ImGui::TextWrapped("%s", why_not.c_str());
  draw_saving(why_not);
  draw_steps(session.scene.attribute);
}

void LineSection::draw_ends() {
  for (const auto& [name, end] : {std::pair("from", &ends_[0]), std::pair("to", &ends_[1])}) {
    dvec3 typed = *end;
    const bool is_new = ImGui::InputScalarN(name, ImGuiDataType_Double, &typed.x, 3, nullptr, nullptr, "%.6g");
    hint("x, y and z, in the units of the file's coordinates");
    if (!is_new || !std::isfinite(typed.x + typed.y + typed.z)) continue;
    *end = typed;
    is_shown_ = why_no_line(viewer_.session->info().cells.has_value(), request()).empty();
  }
}

void LineSection::draw_attributes() {
  std::string names;
  for (const std::string& name : attributes_) names += (names.empty() ? "" : ", ") + name;
  if (!ImGui::BeginCombo("attributes", names.c_str())) return;
  for (const format::Attribute& attribute : viewer_.session->info().attributes) {
    const auto found = std::ranges::find(attributes_, attribute.name);
    bool is_chosen = found != attributes_.end();
    if (!ImGui::Checkbox(attribute.name.c_str(), &is_chosen)) continue;
    if (is_chosen)
      attributes_.push_back(attribute.name);
    else
      attributes_.erase(found);
  }
  ImGui::EndCombo();
}

void LineSection::draw_saving(const std::string& why_not) {
  table_name_.draw("table");
  if (draw_button("save table", why_not)) save_table(table_name_.text());
  hint("As svexport --line does: all places where a value bends or jumps.");
  picture_name_.draw("plot");
  if (draw_button("save plot", has_rows() ? "" : "no line")) save_picture(picture_name_.text());
}

void LineSection::save_table(const std::string& path) {
  if (!has_extension(path, ".csv")) return viewer_.messages.error(path + ": does not end in .csv: give it that ending");
  if (saving_.is_begun()) return viewer_.messages.note(saved_ + " is being written");
  save_.save(path, [this, path, line = request()] {
    saved_ = path;
    saving_ = {viewer_.host, [path, line, steps = viewer_.session->steps()] { return save_line(steps, line, path); }};
  });
}

void LineSection::save_picture(const std::string& path) {
  if (!has_extension(path, ".png")) return viewer_.messages.error(path + ": does not end in .png: give it that ending");
  save_.save(path, [this, path, plot = plot_] {
    const auto image = draw_plot(plot, picture_width, picture_height);
    const Status saved =
        image ? write_image(path, *image, dvec3(1), {{"software", "svview"}}) : Status(tl::unexpected(image.error()));
    viewer_.messages.tell(saved, "saved " + path);
  });
}

// At the line's start, where the first pin is.
void LineSection::draw_steps(const std::string& attribute) {
  const Session& session = *viewer_.session;
  const std::string why_not = why_no_steps(session.info().cells.has_value(), session.times());
  if (reading_steps_.is_begun()) {
    if (ImGui::SmallButton("stop")) return end_steps();
    ImGui::SameLine();
    ImGui::Text("%zu of %zu steps", steps_done_->load(), session.times().size());
    return;
  }
  if (draw_button("start over all steps", why_not)) read_over_steps(attribute);
  hint("The value at the line's start in each step of the series");
  if (!why_not.empty()) ImGui::TextWrapped("%s", why_not.c_str());
}

void LineSection::read_over_steps(const std::string& attribute) {
  const Session& session = *viewer_.session;
  over_steps_ = {.places = session.times(), .curves = {}, .place_name = label_of(session, attribute)};
  place_of_steps_ = ends_[0];
  steps_done_ = std::make_shared<std::atomic<std::size_t>>(0);
  reading_steps_ = {viewer_.host,
                    [steps = session.steps(), attribute, place = place_of_steps_, done = steps_done_] {
                      return read_steps(steps, attribute, place, *done);
                    },
                    SessionHost::Priority::low};
}

// An answer to what nobody asks any more is dropped.
bool LineSection::take_answers() {
  bool is_new = false;
  if (reading_.is_begun() && reading_.wait()) {
    is_new = true;
    auto rows = reading_.take();
    if (rows || rows.error().code != ErrorCode::cancelled) {
      answered_ = std::exchange(asked_, {});
      trouble_ = rows ? "" : rows.error().message;
      rows_ = rows ? std::optional(*std::move(rows)) : std::nullopt;
      if (has_rows()) update_plot();
    }
  }
  if (lighting_.is_begun() && lighting_.wait()) {
    is_new = true;
    auto lights = lighting_.take();
    seen_ = asked_seen_;
    if (lights)
      seen_.lights = *std::move(lights);
    else if (lights.error().code == ErrorCode::cancelled)
      seen_ = {};
  }
  if (reading_steps_.is_begun() && reading_steps_.wait()) {
    is_new = true;
    auto values = reading_steps_.take();
    if (values)
      over_steps_.curves = {{std::exchange(over_steps_.place_name, "time"), *std::move(values)}};
    else
      viewer_.messages.error(values.error().message);
  }
  if (saving_.is_begun() && saving_.wait()) {
    is_new = true;
    viewer_.messages.tell(saving_.take(), "saved " + saved_);
  }
  return is_new;
}

void LineSection::update_plot() {
  plot_ = {.places = rows_->arc_lengths, .curves = {}, .place_name = "distance"};
  for (std::size_t a = 0; a < rows_->values.size(); ++a)
    plot_.curves.push_back({label_of(*viewer_.session, answered_->attributes[a]), rows_->values[a]});
}

void LineSection::ask_rows() {
  const LineRequest line = request();
  if (answered_ == line || line.attributes.empty()) return;
  if (reading_.is_begun()) {
    if (asked_ != line) reading_.interrupt();
    return;
  }
  asked_ = line;
  reading_ = {viewer_.host, [line, steps = viewer_.session->steps()] { return read_line(steps, line); }};
}

// The places at which the line may be hidden or not.
std::vector<dvec3> LineSection::places() const {
  constexpr int count = 33;
  std::vector<dvec3> places;
  for (int i = 0; i < count; ++i) places.push_back(ends_[0] + i / (count - 1.0) * (ends_[1] - ends_[0]));
  return places;
}

// Looks from the eye at the line, where the cells are here.
void LineSection::ask_lights() {
  Session& session = *viewer_.session;
  const Seen now{request(), session.view(), without_camera(session.drawn_scene())};
  if (seen_.is_of(now)) return;
  if (lighting_.is_begun()) {
    if (!asked_seen_.is_of(now)) lighting_.interrupt();
    return;
  }
  const auto cells = session.cells_for_picks();
  if (!cells) return;
  asked_seen_ = now;
  lighting_ = {viewer_.host,
               [now, cells = *cells, surfaces = session.surfaces(), places = places()] {
                 return light_from(*cells.kept, now.scene, surfaces, now.view, places);
               },
               SessionHost::Priority::low};
}

}  // namespace splatvol
