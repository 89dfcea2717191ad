#include "viewer/probes.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pictures/ticks.h"
#include "viewer/window/gui_units.h"
#include "viewer/window/presenter.h"

namespace splatvol {
namespace {

std::string with_unit(double value, const format::Attribute& attribute) {
  return fmt::format("{:.{}g}{}{}", value, digits_of_range(attribute.min, attribute.max),
                     attribute.unit.empty() ? "" : " ", attribute.unit);
}

std::string words_of(const Probe& probe, const format::Attribute& attribute) {
  return fmt::format("{}{}{} {}\nat {:.5g}, {:.5g}, {:.5g}\nopacity {:.0f} %", probe.surface,
                     probe.surface.empty() ? "" : "\n", attribute.name,
                     std::isnan(probe.value) ? "none here" : with_unit(probe.value, attribute), probe.position.x,
                     probe.position.y, probe.position.z, 100 * probe.opacity);
}

std::string table_of(const Probe& probe, const format::Attribute& attribute) {
  std::string text = fmt::format("distance,{},opacity\n", attribute.name);
  for (const Probe::Sample& sample : probe.samples)
    text += fmt::format("{:.9g},{},{:.6g}\n", sample.distance,
                        std::isnan(sample.value) ? "" : fmt::format("{:.9g}", sample.value), sample.opacity);
  return text;
}

// Draws the values along a ray as a line, and its opacity so far as an area that ends at the upper edge for 1.
void draw_plot(const Probe& probe, const format::Attribute& attribute) {
  const float unit = gui_unit();
  const ImVec2 size(300 * unit, 110 * unit);
  const ImVec2 corner = ImGui::GetCursorScreenPos();
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Probe::Sample& sample : probe.samples)
    if (!std::isnan(sample.value)) low = std::min(low, sample.value), high = std::max(high, sample.value);
  const double span = high > low ? high - low : 1;
  const auto x_of = [&](std::size_t i) {
    return corner.x + size.x * static_cast<float>(i) / static_cast<float>(probe.samples.size() - 1);
  };
  const auto y_of = [&](double share) { return corner.y + size.y * (1 - static_cast<float>(share)); };
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(corner, {corner.x + size.x, corner.y + size.y}, ImGui::GetColorU32(ImGuiCol_FrameBg));
  for (std::size_t i = 1; i < probe.samples.size(); ++i) {
    const Probe::Sample &from = probe.samples[i - 1], &to = probe.samples[i];
    const ImVec2 area[] = {
        {x_of(i - 1), y_of(0)}, {x_of(i - 1), y_of(from.opacity)}, {x_of(i), y_of(to.opacity)}, {x_of(i), y_of(0)}};
    list.AddConvexPolyFilled(area, 4, ImGui::GetColorU32(ImGuiCol_PlotHistogram, 0.25f));
    if (std::isnan(from.value) || std::isnan(to.value)) continue;
    list.AddLine({x_of(i - 1), y_of((from.value - low) / span)}, {x_of(i), y_of((to.value - low) / span)},
                 ImGui::GetColorU32(ImGuiCol_Text), 1.5f * unit);
  }
  ImGui::Dummy(size);
  if (ImGui::IsItemHovered()) {
    const double share = static_cast<double>((ImGui::GetMousePos().x - corner.x) / size.x);
    const double last = static_cast<double>(probe.samples.size() - 1);
    const Probe::Sample& sample =
        probe.samples[static_cast<std::size_t>(std::clamp(std::round(share * last), 0.0, last))];
    ImGui::SetTooltip("distance %.5g\n%s %s\nopacity up to here %.0f %%", sample.distance, attribute.name.c_str(),
                      std::isnan(sample.value) ? "none" : with_unit(sample.value, attribute).c_str(),
                      100 * sample.opacity);
  }
  const std::string range =
      fmt::format("{:.{}g} to {}", low, digits_of_range(attribute.min, attribute.max), with_unit(high, attribute));
  const std::string distances =
      fmt::format("distance {:.4g} to {:.4g}", probe.samples.front().distance, probe.samples.back().distance);
  ImGui::TextUnformatted((low <= high ? range : "no values").c_str());
  ImGui::SameLine(
      std::max(ImGui::CalcTextSize(range.c_str()).x + 16 * unit, size.x - ImGui::CalcTextSize(distances.c_str()).x));
  ImGui::TextUnformatted(distances.c_str());
}

}  // namespace

void Probes::end() {
  pin_.reset();
  forget();
}

// Looks through the middle of the pixel at a position in the window.
Looking Probes::looking_at(const dvec2& position) const {
  const PictureArea area = viewer_.picture_area();
  const dvec2 at((position.x - area.left) / area.unit_x, position.y / area.unit_y);
  const dvec2 pixel = glm::floor(at) + 0.5;
  return looking_through(viewer_.session->view(), pixel.x, pixel.y);
}

// The picture tells the opacity of lines of sight from its eye.
Probes::Question Probes::question_about(const Looking& looking) const {
  const Scene& drawn = viewer_.session->drawn_scene();
  Question question{viewer_.session->frame()->serial, drawn.transfer_function, {}, looking, {}};
  if (drawn.opacity) question.opacity_function = drawn.opacity->function;
  question.surfaces = drawn.surfaces;
  const View& view = viewer_.session->view();
  const dvec3 at = view.to_view(looking.ray.origin + looking.ray.direction);
  const dvec3 from = view.to_view(looking.ray.origin);
  const bool is_of_view = view.orthographic ? looking.orthographic && view.forward == looking.ray.direction
                                            : !looking.orthographic && view.eye == looking.ray.origin && at.z > 0;
  if (!is_of_view) return question;
  const dvec3 in_picture = view.orthographic ? view.focal * from : view.focal / at.z * at;
  question.opacity = opacity_at(*viewer_.session, static_cast<int>(std::floor(in_picture.x + 0.5 * view.width)),
                                static_cast<int>(std::floor(0.5 * view.height - in_picture.y)));
  return question;
}

// Copies the frame's list, unless the frame is known.
void Probes::ask(const Question& question) {
  if (is_busy() || answered_ == question) return;
  const Session& session = *viewer_.session;
  const bool is_known = last_.frame && answered_->serial == question.serial;
  auto answer = [question, units = session.units(), steps = session.steps(), step = session.step(),
                 attribute = session.drawn_scene().attribute, known = is_known ? last_.frame : nullptr,
                 cells = last_.cells, surfaces = session.surfaces(), view = session.view(),
                 list = is_known ? DrawList() : session.frame()->list]() mutable -> Answer {
    if (!known) {
      known = std::make_shared<const ProbedFrame>(std::move(list), units);
      cells = ProbedCells::open(steps, step, attribute).value_or(nullptr);
    }
    const auto& factors = question.opacity_function;
    auto probe = with_surfaces(
        known->probe({question.function, factors ? &*factors : nullptr}, question.looking, question.opacity), surfaces,
        view, question.looking.ray);
    if (probe && cells) cells->take_values(question.looking.ray, *probe);
    return {std::move(known), std::move(cells), std::move(probe)};
  };
  asked_ = question;
  last_.frame.reset();
  last_.cells.reset();
  answer_ = {viewer_.host, std::move(answer)};
}

bool Probes::take_answer() {
  if (!is_busy() || !answer_.wait()) return false;
  last_ = answer_.take();
  answered_ = std::exchange(asked_, {});
  return true;
}

// Null until it is there.
const std::optional<Probe>* Probes::answer_to(const Question& question) const {
  return answered_ == question ? &last_.probe : nullptr;
}

// Lets go of the frame's rows, unless an answer is on its way.
void Probes::forget() {
  if (is_busy()) return;
  last_ = {};
  answered_.reset();
}

// A slice in front of the volume's middle takes its place.
std::optional<Probe> Probes::with_slices(const std::optional<Probe>& volume, const Ray& ray) const {
  auto on_slice =
      probe_slices(viewer_.session->frame()->sliced, viewer_.session->units(), viewer_.session->view(), ray);
  const auto distance = [&](const Probe& probe) { return glm::length(probe.position - ray.origin); };
  return on_slice && (!volume || distance(*on_slice) < distance(*volume)) ? on_slice : volume;
}

void Probes::pin(const dvec2& position) {
  if (!viewer_.shown.probe || !viewer_.session || !viewer_.session->frame()) return;
  pin_ = Pin{looking_at(position)};
}

void Probes::draw(bool is_at_rest, bool over_picture) {
  const FrameSplats* frame = viewer_.session->frame();
  if (!frame || viewer_.session->is_drawing()) return draw_pinned();
  is_at_rest = is_at_rest && !viewer_.session->is_reading();
  if (!is_at_rest) forget();
  if (pin_ && is_at_rest) {
    const Question question = question_about(pin_->looking);
    if (const auto* answer = answer_to(question)) {
      pin_->asked = question;
      pin_->probe = with_slices(*answer, pin_->looking.ray);
      if (!pin_->probe) pin_.reset();  // nothing is there
    } else if (pin_->asked != question) {
      ask(question);
    }
  }
  draw_pinned();
  if (is_at_rest && over_picture) draw_hovered();
}

// Shows the probe beside the pointer.
void Probes::draw_hovered() {
  const dvec2 pointer = viewer_.steering.pointer();
  if (pointer.x < viewer_.picture_area().left) return;
  const Question question = question_about(looking_at(pointer));
  const auto* answer = answer_to(question);
  if (!answer) return ask(question);
  if (const auto found = with_slices(*answer, question.looking.ray))
    ImGui::SetTooltip("%s", words_of(*found, viewer_.session->attribute()).c_str());
}

// Shows the pinned probe: a ring where its value is, and a window.
void Probes::draw_pinned() {
  if (!pin_ || !pin_->probe) return;
  const Probe& probe = *pin_->probe;
  const PictureArea area = viewer_.picture_area();
  const View& view = viewer_.session->view();
  const float scale = viewer_.scale();
  const dvec3 at = view.to_view(probe.position);
  if (view.orthographic || at.z > 0) {
    const double by = view.focal / (view.orthographic ? 1 : at.z);
    const ImVec2 center(static_cast<float>(area.left + area.unit_x * (by * at.x + 0.5 * view.width)),
                        static_cast<float>(area.unit_y * (0.5 * view.height - by * at.y)));
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    list.PushClipRect({static_cast<float>(area.left), 0}, {static_cast<float>(area.left + area.width), 1e6f});
    list.AddCircle(center, 6 * scale, IM_COL32(0, 0, 0, 255), 24, 3 * scale);
    list.AddCircle(center, 6 * scale, IM_COL32(255, 255, 255, 255), 24, 1.5f * scale);
    list.PopClipRect();
  }
  ImGui::SetNextWindowPos({static_cast<float>(area.left) + 8 * scale, static_cast<float>(area.height) - 8 * scale},
                          ImGuiCond_Appearing, {0, 1});
  bool stays = true;
  ImGui::Begin("pinned", &stays, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoCollapse);
  ImGui::TextUnformatted(words_of(probe, viewer_.session->attribute()).c_str());
  if (!probe.samples.empty()) draw_plot(probe, viewer_.session->attribute());
  if (ImGui::SmallButton("copy"))
    ImGui::SetClipboardText(fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},{:.6g}\n", probe.position.x, probe.position.y,
                                        probe.position.z, probe.value, probe.opacity)
                                .c_str());
  hint("Copies x, y, z, the value and the opacity.");
  ImGui::SameLine();
  if (ImGui::SmallButton("copy plot")) ImGui::SetClipboardText(table_of(probe, viewer_.session->attribute()).c_str());
  hint("Copies the table of distance, value and opacity.");
  ImGui::End();
  if (!stays) pin_.reset();
}

}  // namespace splatvol
