#include "viewer/measure_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "sampler/vector_field.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

std::string text_of(const dvec3& p) { return fmt::format("({:.4g}, {:.4g}, {:.4g})", p.x, p.y, p.z); }

// `size`: the volume or the area with a value.
void draw_attribute(const ValueIntegral& of, double size, double missing) {
  ImGui::TextUnformatted((of.unit.empty() ? of.name : of.name + " (" + of.unit + ")").c_str());
  ImGui::Indent();
  if (size > 0) {
    ImGui::TextWrapped("%s", fmt::format("mean {:.6g}, integral {:.6g}", of.mean, of.integral).c_str());
    ImGui::TextWrapped("%s", fmt::format("min {:.6g} at {}", of.low, text_of(of.low_position)).c_str());
    ImGui::TextWrapped("%s", fmt::format("max {:.6g} at {}", of.high, text_of(of.high_position)).c_str());
  }
  if (missing > 0) ImGui::TextUnformatted(fmt::format("no value in {:.6g} of it", missing).c_str());
  ImGui::Unindent();
}

void draw_unknown(double unknown, std::uint64_t left_out) {
  if (unknown > 0)
    ImGui::TextWrapped("%s",
                       fmt::format("left out: {:.6g} where an attribute of a range has no value", unknown).c_str());
  if (left_out > 0)
    ImGui::TextWrapped("%s",
                       fmt::format("left out: {} cells of shapes that this program does not know", left_out).c_str());
}

void draw_numbers(const Integrals& of) {
  ImGui::TextUnformatted(fmt::format("volume {:.6g}", of.volume).c_str());
  for (const Integral& attribute : of.attributes) draw_attribute(attribute, attribute.volume, attribute.missing_volume);
  draw_unknown(of.unknown_volume, of.left_out);
}

void draw_numbers(const SurfaceIntegrals& of) {
  ImGui::TextUnformatted(fmt::format("area {:.6g}", of.area).c_str());
  if (!std::isnan(of.flux)) ImGui::TextUnformatted(fmt::format("flux {:.6g}", of.flux).c_str());
  for (const SurfaceIntegral& attribute : of.attributes)
    draw_attribute(attribute, attribute.area, attribute.missing_area);
  draw_unknown(of.unknown_area, of.left_out);
}

// A combo of names; `none`: the text for an empty one. Returns whether the name has changed.
bool choose_name(const char* label, const char* none, const std::vector<std::string>& names, std::string& name) {
  if (!ImGui::BeginCombo(label, name.empty() ? none : name.c_str())) return false;
  const std::string before = name;
  if (none && ImGui::Selectable(none, name.empty())) name.clear();
  for (const std::string& choice : names)
    if (ImGui::Selectable(choice.c_str(), choice == name)) name = choice;
  ImGui::EndCombo();
  return name != before;
}

}  // namespace

void MeasureSection::begin() {
  measuring_.end();
  contour_.reset(), slice_.reset(), answer_.reset();
  vector_.clear();
  ranges_.clear();
}

MeasureRequest MeasureSection::request() const {
  const Session& session = *viewer_.session;
  MeasureRequest request{.step = session.step(), .integrals = region_of(session.scene)};
  request.integrals.ranges = ranges_;
  if (contour_) request.surface = ContourSurface{session.scene.attribute, *contour_};
  if (slice_) request.surface = HalfSpace{session.scene.slices[*slice_].point, session.scene.slices[*slice_].normal};
  if ((contour_ || slice_) && !vector_.empty()) request.vector = {vector_ + "[0]", vector_ + "[1]", vector_ + "[2]"};
  return request;
}

// Cells, a contour of the scene, or one of its slices.
void MeasureSection::draw_surface(const std::vector<double>& contours) {
  const Scene& scene = viewer_.session->scene;
  if (contour_ && std::ranges::find(contours, *contour_) == contours.end()) contour_.reset();
  if (slice_ && *slice_ >= scene.slices.size()) slice_.reset();
  const auto name_of_contour = [&](double value) { return fmt::format("contour {} = {:.6g}", scene.attribute, value); };
  const auto name_of_slice = [](std::size_t slice) { return fmt::format("slice {}", slice + 1); };
  const std::string shown = contour_ ? name_of_contour(*contour_) : slice_ ? name_of_slice(*slice_) : "cells";
  if (!ImGui::BeginCombo("of", shown.c_str())) return;
  if (ImGui::Selectable("cells", !contour_ && !slice_)) contour_.reset(), slice_.reset();
  for (const double value : contours)
    if (ImGui::Selectable(name_of_contour(value).c_str(), contour_ == value)) contour_ = value, slice_.reset();
  for (std::size_t slice = 0; slice < scene.slices.size(); ++slice)
    if (ImGui::Selectable(name_of_slice(slice).c_str(), slice_ == slice)) slice_ = slice, contour_.reset();
  ImGui::EndCombo();
}

// Of a contour or a slice.
void MeasureSection::draw_vector() {
  const std::vector<std::string> vectors = vectors_of(viewer_.session->info());
  const bool is_surface = contour_ || slice_;
  if (std::ranges::find(vectors, vector_) == vectors.end()) vector_.clear();
  ImGui::BeginDisabled(!is_surface || vectors.empty());
  choose_name("flux of", "nothing", vectors, vector_);
  ImGui::EndDisabled();
  const char* const text = !is_surface       ? "A flux is through a contour or a slice."
                           : vectors.empty() ? "The file has no vector: no attributes NAME[0], NAME[1], NAME[2]."
                                             : "Along the normal of a slice; through a contour to lower values";
  hint(text);
}

void MeasureSection::draw_ranges() {
  const format::VolumeInfo& info = viewer_.session->info();
  std::vector<std::string> names;
  for (const format::Attribute& attribute : info.attributes) names.push_back(attribute.name);
  const auto set_limits = [&](ValueRange& range) {
    const int number = info.find_attribute(range.attribute);
    if (number < 0) return;
    range.low = info.attributes[static_cast<std::size_t>(number)].min;
    range.high = info.attributes[static_cast<std::size_t>(number)].max;
  };
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < ranges_.size(); ++i) {
    ValueRange& range = ranges_[i];
    ImGui::PushID(static_cast<int>(i));
    ImGui::SetNextItemWidth(150 * viewer_.scale());  // leaves room for the button
    if (choose_name("range", nullptr, names, range.attribute)) set_limits(range);
    ImGui::SameLine();
    if (ImGui::SmallButton("remove")) removed = i;
    std::array<double, 2> limits = {range.low, range.high};
    if (ImGui::InputScalarN("from, to", ImGuiDataType_Double, limits.data(), 2, nullptr, nullptr, "%.6g") &&
        limits[0] <= limits[1])
      range.low = limits[0], range.high = limits[1];
    ImGui::PopID();
  }
  if (removed) ranges_.erase(ranges_.begin() + static_cast<std::ptrdiff_t>(*removed));
  if (!ImGui::SmallButton("add range")) return;
  set_limits(ranges_.emplace_back(ValueRange{.attribute = viewer_.session->scene.attribute}));
}

void MeasureSection::draw_begin() {
  const Session& session = *viewer_.session;
  const bool may_begin = session.info().cells.has_value() && !session.is_reading() && !is_begun();
  ImGui::BeginDisabled(!may_begin);
  if (ImGui::SmallButton("measure"))
    measuring_.begin(viewer_.host, session.steps(), request(), session.settings.memory / 8);
  ImGui::EndDisabled();
  const char* const text = session.info().cells
                               ? "All attributes, over the cells in the clip box, the clip planes and the "
                                 "ranges:\nvolume or area, mean, least and greatest value"
                               : "The file keeps no cells: build it without --drop-cells.";
  hint(text);
}

void MeasureSection::draw() {
  std::vector<double> contours;
  for (const Contour& contour : contours_of(viewer_.session->scene).surfaces) contours.push_back(contour.value);
  ImGui::PushID("measure");
  draw_surface(contours);
  draw_vector();
  draw_ranges();
  draw_begin();
  draw_result();
  ImGui::PopID();
}

// Numbers of something else than what would be measured now are grey.
void MeasureSection::draw_result() const {
  if (!answer_) return;
  const bool is_old = answer_->request != request();
  ImGui::BeginDisabled(is_old);
  if (is_old) ImGui::TextUnformatted("out of date:");
  std::visit([](const auto& numbers) { draw_numbers(numbers); }, answer_->numbers);
  ImGui::EndDisabled();
}

void MeasureSection::draw_progress() {
  if (auto result = measuring_.take()) {
    if (*result)
      answer_ = Answer{measuring_.request(), std::move(**result)};
    else if (result->error().code != ErrorCode::cancelled)
      viewer_.messages.error(result->error().message);
  }
  if (!is_begun()) return;
  const Messages::Work work{.name = "measure", .text = "measuring", .buttons = {"stop"}, .share = measuring_.share()};
  if (viewer_.messages.draw(work)) measuring_.interrupt();
}

}  // namespace splatvol
