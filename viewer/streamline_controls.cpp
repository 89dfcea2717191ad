#include "viewer/streamline_controls.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <variant>

#include "sampler/streamlines.h"
#include "sampler/vector_field.h"
#include "viewer/coloring.h"
#include "viewer/projection.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr float handle_radius = 7, grip = 11, seed_radius = 2;  // window units, at scale 1
constexpr std::size_t most_seeds_drawn = 1000;
constexpr int most_on_a_side = 1000;
constexpr double usual_radius = 1.0 / 400;  // of the diagonal of the mesh's box

// Why the file can have no streamlines; empty: it can.
std::string why_none(const Session& session) {
  if (!session.info().cells) return "This file keeps no cells, and only these have streamlines.";
  if (vectors_of(session.info()).empty()) return "This file has no vector of three components.";
  return {};
}

// The axis along which a vector points most, by the ranges of its components.
int axis_of(const std::string& vector, const format::VolumeInfo& info) {
  dvec3 sum(0);
  for (int axis = 0; axis < 3; ++axis) {
    const int number = info.find_attribute(fmt::format("{}[{}]", vector, axis));
    const format::Attribute& component = info.attributes[static_cast<std::size_t>(number)];
    sum[axis] = std::abs(component.min + component.max);
  }
  return longest_axis(sum);
}

// A line through the middle of the mesh, across the vector.
SceneStreamlines usual_streamlines(const Session& session) {
  const std::string vector = vectors_of(session.info()).front();
  const Box& box = session.mesh_box();
  const dvec3 middle = 0.5 * (box.low + box.high);
  dvec3 sides = box.extent(), half(0);
  sides[axis_of(vector, session.info())] = 0;
  const int axis = longest_axis(sides);
  half[axis] = 0.4 * box.extent()[axis];
  SceneStreamlines added{.vector = vector,
                         .seeds = SeedLine{middle - half, middle + half, 20},
                         .radius = usual_radius * glm::length(box.extent())};
  const int magnitude = session.info().find_attribute(added.vector);
  if (magnitude >= 0)
    added.color_by = coloring_by(session.scene, session.info().attributes[static_cast<std::size_t>(magnitude)]);
  return added;
}

// The corners that can be moved.
std::vector<dvec3*> corners_of(Seeds& seeds) {
  if (auto* line = std::get_if<SeedLine>(&seeds)) return {&line->start, &line->end};
  if (auto* rectangle = std::get_if<SeedRectangle>(&seeds))
    return {&rectangle->corner, &rectangle->first, &rectangle->second};
  return {};
}

// The corners, and then the middle.
std::vector<dvec3> handles_of(Seeds seeds) {
  std::vector<dvec3> handles;
  for (const dvec3* corner : corners_of(seeds)) handles.push_back(*corner);
  if (handles.size() == 2) handles.push_back(0.5 * (handles[0] + handles[1]));
  if (handles.size() == 3 && std::holds_alternative<SeedRectangle>(seeds))
    handles.push_back(0.5 * (handles[1] + handles[2]));
  return handles;
}

// Corners of what is drawn through them.
std::vector<dvec3> outline_of(const Seeds& seeds) {
  if (const auto* line = std::get_if<SeedLine>(&seeds)) return {line->start, line->end};
  if (const auto* of = std::get_if<SeedRectangle>(&seeds))
    return {of->corner, of->first, of->first + of->second - of->corner, of->second, of->corner};
  return {};
}

// Choices of one combo box: returns which of some words is chosen.
std::optional<std::size_t> choose(const char* label, const std::string& shown, const std::vector<std::string>& words) {
  std::optional<std::size_t> chosen;
  if (!ImGui::BeginCombo(label, shown.c_str())) return chosen;
  for (std::size_t i = 0; i < words.size(); ++i)
    if (ImGui::Selectable(words[i].c_str(), words[i] == shown)) chosen = i;
  ImGui::EndCombo();
  return chosen;
}

void draw_count(const char* label, std::size_t& count) {
  int shown = static_cast<int>(count);
  if (ImGui::SliderInt(label, &shown, 1, most_on_a_side, "%d", ImGuiSliderFlags_Logarithmic))
    count = static_cast<std::size_t>(std::clamp(shown, 1, most_on_a_side));
  hint("Control click: type a number.");
}

// Takes another shape where the seeds are.
Seeds in_shape(const Seeds& seeds, std::size_t shape, const Session& session, const std::vector<std::string>& patches) {
  const SeedLine usual = std::get<SeedLine>(usual_streamlines(session).seeds);
  const dvec3 corner = std::holds_alternative<SeedLine>(seeds)        ? std::get<SeedLine>(seeds).start
                       : std::holds_alternative<SeedRectangle>(seeds) ? std::get<SeedRectangle>(seeds).corner
                                                                      : usual.start;
  const dvec3 first = std::holds_alternative<SeedLine>(seeds)        ? std::get<SeedLine>(seeds).end
                      : std::holds_alternative<SeedRectangle>(seeds) ? std::get<SeedRectangle>(seeds).first
                                                                     : usual.end;
  if (shape == 0) return SeedLine{corner, first, 20};
  if (shape > 1) return SeedPatch{patches[shape - 2], 100};
  const dvec3 side = first - corner, extent = session.mesh_box().extent();
  dvec3 other(0);  // across the side, along the longest axis that is left
  const int along = longest_axis(glm::abs(side));
  const int axis = extent[(along + 1) % 3] >= extent[(along + 2) % 3] ? (along + 1) % 3 : (along + 2) % 3;
  other[axis] = 0.5 * extent[axis];
  return SeedRectangle{corner, first, corner + other, {10, 10}};
}

void draw_seeds(const Session& session, Seeds& seeds) {
  std::vector<std::string> words = {"on a line", "on a rectangle"}, patches;
  if (session.info().boundary)
    for (const format::PatchInfo& patch : session.info().boundary->patches) {
      if (patch.triangles == 0) continue;
      patches.push_back(patch.name);
      words.push_back("on " + patch.name);
    }
  const auto* patch = std::get_if<SeedPatch>(&seeds);
  const std::string shown = patch                                          ? "on " + patch->patch
                            : std::holds_alternative<SeedRectangle>(seeds) ? words[1]
                            : std::holds_alternative<SeedLine>(seeds)      ? words[0]
                                                                           : "at positions";
  if (const auto chosen = choose("seeds", shown, words)) seeds = in_shape(seeds, *chosen, session, patches);
  hint("Where the lines begin.\nDrag the handles in the picture, or type positions.");
  if (auto* line = std::get_if<SeedLine>(&seeds)) draw_count("count", line->count);
  if (auto* of = std::get_if<SeedPatch>(&seeds)) draw_count("count", of->count);
  if (auto* rectangle = std::get_if<SeedRectangle>(&seeds)) {
    draw_count("first side", rectangle->counts[0]);
    draw_count("second side", rectangle->counts[1]);
  }
  const std::vector<dvec3*> corners = corners_of(seeds);
  const std::array<const char*, 3> names =
      corners.size() == 2 ? std::array{"start", "end", ""} : std::array{"corner", "first", "second"};
  const float speed = static_cast<float>(glm::length(session.mesh_box().extent()) / 500);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    dvec3 at = *corners[i];
    if (ImGui::DragScalarN(names[i], ImGuiDataType_Double, &at.x, 3, speed, nullptr, nullptr, "%.4g") &&
        std::isfinite(glm::length(at)))
      *corners[i] = at;
    hint("In the units of the file's coordinates.\nDrag, or control click: type a number.");
  }
}

void draw_color(Session& session, SceneStreamlines& streamlines) {
  std::vector<std::string> words = {"one colour"};
  for (const format::Attribute& attribute : session.info().attributes) words.push_back("by " + attribute.name);
  const std::string shown = streamlines.color_by ? "by " + streamlines.color_by->attribute : words[0];
  if (const auto chosen = choose("colour", shown, words)) {
    streamlines.color_by.reset();
    if (*chosen > 0) streamlines.color_by = coloring_by(session.scene, session.info().attributes[*chosen - 1]);
  }
  hint("One, or by the values of an attribute on the lines");
}

}  // namespace

void StreamlineControls::draw_selected(Session& session, SceneStreamlines& streamlines) const {
  const std::vector<std::string> vectors = vectors_of(session.info());
  if (const auto chosen = choose("vector", streamlines.vector, vectors)) streamlines.vector = vectors[*chosen];
  draw_seeds(session, streamlines.seeds);
  const std::vector<std::string> directions = {"both ways", "forward", "backward"};
  if (const auto chosen = choose("direction", directions[static_cast<std::size_t>(streamlines.direction)], directions))
    streamlines.direction = static_cast<StreamlineDirection>(*chosen);
  const double size = glm::length(session.mesh_box().extent());
  const double shortest = 0.01 * size, longest = 5 * size, thinnest = size / 10'000, thickest = size / 20;
  double length = streamlines.max_length.value_or(longest);
  if (ImGui::SliderScalar("length", ImGuiDataType_Double, &length, &shortest, &longest, "%.3g",
                          ImGuiSliderFlags_Logarithmic) &&
      length > 0)
    streamlines.max_length = length;
  hint("From the seed, each way, in the units of the file's coordinates.\nControl click: type a number.");
  double radius = streamlines.radius;
  if (ImGui::SliderScalar("radius", ImGuiDataType_Double, &radius, &thinnest, &thickest, "%.3g",
                          ImGuiSliderFlags_Logarithmic) &&
      radius > 0 && std::isfinite(radius))
    streamlines.radius = radius;
  hint("Of the tubes.\nControl click: type a number.");
  draw_color(session, streamlines);
}

// A click changes rows below it only.
void StreamlineControls::draw_panel(Session& session) {
  std::vector<SceneStreamlines>& all = session.scene.streamlines;
  const std::string why = why_none(session);
  ImGui::PushID("streamlines");
  ImGui::BeginDisabled(!why.empty());
  if (ImGui::SmallButton("add streamlines")) {
    selected_ = all.size();
    all.push_back(usual_streamlines(session));
  }
  ImGui::EndDisabled();
  hint("Tubes that are everywhere parallel to a vector, from seeds that you drag");
  if (!why.empty()) ImGui::TextWrapped("%s", why.c_str());
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < all.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    ImGui::Checkbox("##shown", &all[i].shown);
    ImGui::SameLine();
    if (ImGui::RadioButton(fmt::format("streamlines {}", i + 1).c_str(), selected_ == i))
      selected_ = selected_ == i ? std::nullopt : std::optional(i);
    hint("Shows handles: drag the white balls to move an end of the seeds, the yellow one to move them all.");
    ImGui::SameLine();
    if (ImGui::SmallButton("remove")) removed = i;
    const auto& counts = session.streamline_counts();
    if (all[i].shown && i < counts.size() && counts[i].seeds > 0)
      ImGui::Text("%zu lines of %zu seeds%s", counts[i].lines, counts[i].seeds,
                  session.is_following() ? ", more to come" : "");
    if (selected_ == i && why.empty()) draw_selected(session, all[i]);
    ImGui::PopID();
  }
  if (removed) {
    all.erase(all.begin() + static_cast<std::ptrdiff_t>(*removed));
    reset();
  }
  ImGui::PopID();
}

void StreamlineControls::draw_handles(const Scene& scene, const View& view, const PictureArea& area) const {
  if (!selected_ || *selected_ >= scene.streamlines.size() || !scene.streamlines[*selected_].shown) return;
  const Seeds& seeds = scene.streamlines[*selected_].seeds;
  const Projection projection(view, area);
  ImDrawList& canvas = *ImGui::GetBackgroundDrawList();
  const ImU32 color = IM_COL32(255, 210, 80, 255), dark = IM_COL32(0, 0, 0, 160), white = IM_COL32(255, 255, 255, 255);
  const float unit = gui_unit();
  const std::vector<dvec3> outline = outline_of(seeds);
  for (std::size_t i = 1; i < outline.size(); ++i) {
    const auto from = projection.at(outline[i - 1]), to = projection.at(outline[i]);
    if (!from || !to) continue;
    canvas.AddLine(*from, *to, dark, 4 * unit);
    canvas.AddLine(*from, *to, color, 2 * unit);
  }
  if (count_of(seeds) <= most_seeds_drawn)
    for (const dvec3& seed : positions_on(seeds))
      if (const auto at = projection.at(seed)) canvas.AddCircleFilled(*at, seed_radius * unit, white);
  const std::vector<dvec3> handles = handles_of(seeds);
  for (std::size_t i = 0; i < handles.size(); ++i) {
    const auto at = projection.at(handles[i]);
    if (!at) continue;
    const float radius = handle_radius * unit * (held_ == i ? 1.3F : 1.0F);
    canvas.AddCircleFilled(*at, radius + unit, dark);
    canvas.AddCircleFilled(*at, radius, i + 1 == handles.size() ? color : white);
  }
}

bool StreamlineControls::grab(const Scene& scene, const View& view, const PictureArea& area, const dvec2& pointer) {
  held_.reset();
  if (!selected_ || *selected_ >= scene.streamlines.size() || !scene.streamlines[*selected_].shown) return false;
  const Projection projection(view, area);
  const std::vector<dvec3> handles = handles_of(scene.streamlines[*selected_].seeds);
  for (std::size_t i = 0; i < handles.size() && !held_; ++i)
    if (const auto at = projection.at(handles[i]);
        at && std::hypot(at->x - pointer.x, at->y - pointer.y) <= static_cast<double>(grip * gui_unit()))
      held_ = i;
  return held_.has_value();
}

void StreamlineControls::drag(Scene& scene, const View& view, const PictureArea& area, const dvec2& moved) {
  if (!held_ || !selected_ || *selected_ >= scene.streamlines.size()) return release();
  Seeds& seeds = scene.streamlines[*selected_].seeds;
  const std::vector<dvec3> handles = handles_of(seeds);
  if (*held_ >= handles.size()) return release();
  const dvec3 way = Projection(view, area).way_of(moved, handles[*held_]);
  const std::vector<dvec3*> corners = corners_of(seeds);
  for (std::size_t i = 0; i < corners.size(); ++i)
    if (*held_ == i || *held_ + 1 == handles.size()) *corners[i] += way;
}

}  // namespace splatvol
