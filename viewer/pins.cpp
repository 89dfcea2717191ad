#include "viewer/pins.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "pictures/ticks.h"
#include "player/cell_ray.h"
#include "viewer/plot.h"
#include "viewer/window/gui_units.h"
#include "viewer/window/presenter.h"

namespace splatvol {
namespace {

std::string with_unit(double value, const format::Attribute& attribute) {
  return fmt::format("{:.{}g}{}{}", value, digits_of_range(attribute.min, attribute.max),
                     attribute.unit.empty() ? "" : " ", attribute.unit);
}

// Returns an attribute of the file as the session shows it.
format::Attribute attribute_of(const Session& session, const std::string& name) {
  if (name == session.attribute().name) return session.attribute();
  const auto& all = session.info().attributes;
  const auto found = std::ranges::find(all, name, &format::Attribute::name);
  return found != all.end() ? *found : session.attribute();
}

std::string words_of(const Pick& pick, const Session& session) {
  std::string text = pick.name.empty() ? "" : pick.name + "\n";
  for (const auto& [attribute, value] : pick.values)
    text += fmt::format("{} {}\n", attribute,
                        std::isnan(value) ? "none here" : with_unit(value, attribute_of(session, attribute)));
  return text + fmt::format("at {:.5g}, {:.5g}, {:.5g}\nopacity {:.0f} %", pick.position.x, pick.position.y,
                            pick.position.z, 100 * pick.opacity);
}

std::string table_of(const Pick& pick, const format::Attribute& attribute) {
  std::string text = fmt::format("distance,{},opacity\n", attribute.name);
  for (const Pick::Row& row : pick.rows)
    text += fmt::format("{:.9g},{},{:.6g}\n", row.distance,
                        std::isnan(row.value) ? "" : fmt::format("{:.9g}", row.value), row.opacity);
  return text;
}

// Draws the values along a ray as a line, and its opacity so far as an area that ends at the upper edge for 1.
void draw_plot(const Pick& pick, const format::Attribute& attribute) {
  const float unit = gui_unit();
  const ImVec2 size(300 * unit, 110 * unit);
  std::vector<double> distances, values, opacities;
  for (const Pick::Row& row : pick.rows) {
    distances.push_back(row.distance);
    values.push_back(row.value);
    opacities.push_back(row.opacity);
  }
  const Plot plot(distances, size);
  const PlotRange range = range_of(values);
  plot.draw_area(opacities);
  plot.draw_curve(values, range, ImGui::GetColorU32(ImGuiCol_Text));
  if (const auto place = plot.end()) {
    const auto behind = std::ranges::lower_bound(distances, *place);
    const auto row = static_cast<std::size_t>(std::min(behind, distances.end() - 1) - distances.begin());
    ImGui::SetTooltip("distance %.5g\n%s %s\nopacity up to here %.0f %%", distances[row], attribute.name.c_str(),
                      std::isnan(values[row]) ? "none" : with_unit(values[row], attribute).c_str(),
                      100 * opacities[row]);
  }
  const std::string words = range.is_empty()
                                ? "no values"
                                : fmt::format("{:.{}g} to {}", range.low, digits_of_range(attribute.min, attribute.max),
                                              with_unit(range.high, attribute));
  const std::string ends = fmt::format("distance {:.4g} to {:.4g}", distances.front(), distances.back());
  ImGui::TextUnformatted(words.c_str());
  ImGui::SameLine(
      std::max(ImGui::CalcTextSize(words.c_str()).x + 16 * unit, size.x - ImGui::CalcTextSize(ends.c_str()).x));
  ImGui::TextUnformatted(ends.c_str());
}

}  // namespace

void Pins::end() {
  unpin();
  answer_.end();
  forget();
}

// Looks through the middle of the pixel at a position in the window.
Looking Pins::looking_at(const dvec2& position) const {
  const dvec2 at = (position - dvec2(viewer_.picture_area().left, 0)) / viewer_.window_units();
  const dvec2 pixel = glm::floor(at) + 0.5;
  return looking_through(viewer_.session->view(), pixel.x, pixel.y);
}

// None while splats are drawn that would answer.
std::optional<Pins::Question> Pins::question_about(const Looking& looking) const {
  Session& session = *viewer_.session;
  Question question{looking, session.drawn_scene(), session.step()};
  question.scene.camera = {};
  question.scene.width = question.scene.height = 0;
  question.of_cells = session.cells_for_picks().has_value();
  if (question.of_cells) return question;
  if (session.is_drawing() || !session.frame()) return {};
  question.serial = session.frame()->serial;
  question.opacity = opacity_of(looking);
  return question;
}

// The picture tells the opacity of lines of sight from its eye.
std::optional<double> Pins::opacity_of(const Looking& looking) const {
  const View& view = viewer_.session->view();
  const dvec3 at = view.to_view(looking.ray.origin + looking.ray.direction);
  const dvec3 from = view.to_view(looking.ray.origin);
  const bool is_of_view = view.orthographic ? looking.orthographic && view.forward == looking.ray.direction
                                            : !looking.orthographic && view.eye == looking.ray.origin && at.z > 0;
  if (!is_of_view) return {};
  const dvec3 in_picture = view.orthographic ? view.focal * from : view.focal / at.z * at;
  return opacity_at(*viewer_.session, static_cast<int>(std::floor(in_picture.x + 0.5 * view.width)),
                    static_cast<int>(std::floor(0.5 * view.height - in_picture.y)));
}

void Pins::ask(const Question& question) {
  if (is_busy() || answered_ == question) return;
  asked_ = question;
  question.of_cells ? ask_cells(question) : ask_splats(question);
  answered_.reset();
}

void Pins::ask_cells(const Question& question) {
  last_ = {};
  const Session& session = *viewer_.session;
  answer_ = {viewer_.host,
             [question, cells = *viewer_.session->cells_for_picks(), surfaces = session.surfaces()]() -> Answer {
               auto found = pick_cells(*cells.kept, question.scene, surfaces, question.looking.ray);
               if (!found) return {.trouble = found.error()};
               return {.pick = *std::move(found)};
             }};
}

// Copies the frame's lists, unless the frame is known.
void Pins::ask_splats(const Question& question) {
  const Session& session = *viewer_.session;
  auto known = answered_ && answered_->serial == question.serial ? last_.splats : nullptr;
  last_ = {};
  auto answer = [question, known, units = session.units(), surfaces = session.surfaces(),
                 function = session.function_of_splats(), list = known ? DrawList() : session.frame()->list,
                 sliced = known ? DrawList() : session.frame()->sliced]() mutable -> Answer {
    if (!known)
      known = std::make_shared<const PickedSplats>(std::move(list), std::move(sliced), units, question.scene.attribute);
    auto found = pick_splats(*known, question.scene, function, surfaces, question.looking, question.opacity);
    return {std::move(known), std::move(found)};
  };
  answer_ = {viewer_.host, std::move(answer)};
}

bool Pins::take_answer() {
  if (!is_busy() || !answer_.wait()) return false;
  last_ = answer_.take();
  answered_ = std::exchange(asked_, {});
  if (!last_.trouble) return true;
  if (last_.trouble->code == ErrorCode::cancelled)
    answered_.reset();
  else
    viewer_.messages.error(last_.trouble->message);
  return true;
}

// Null until it is there.
const std::optional<Pick>* Pins::answer_to(const Question& question) const {
  return answered_ == question ? &last_.pick : nullptr;
}

// Lets go of the frame's rows, unless an answer is on its way.
void Pins::forget() {
  if (is_busy()) return answer_.interrupt();
  last_ = {};
  answered_.reset();
}

void Pins::pin(const dvec2& position) {
  if (!viewer_.shown.values || !viewer_.session || viewer_.session->shown_number() == 0) return;
  unpin();
  pin_ = Pin{looking_at(position)};
}

void Pins::pin_end(const dvec2& position) {
  if (!pin_) return pin(position);
  end_ = Pin{looking_at(position)};
}

std::optional<std::array<dvec3, 2>> Pins::take_ends() {
  if (!pin_ || !pin_->pick || !end_ || !end_->pick) return {};
  const dvec3 end = end_->pick->position;
  end_.reset();
  return std::array{pin_->pick->position, end};
}

void Pins::draw(bool is_at_rest, bool over_picture, bool has_plot) {
  if (viewer_.session->shown_number() == 0) return;
  is_at_rest = is_at_rest && !viewer_.session->is_reading();
  const dvec2 pointer = viewer_.steering.pointer();
  std::optional<Question> hovered;
  if (!is_at_rest) {
    forget();
  } else {
    if (over_picture && pointer.x >= viewer_.picture_area().left) hovered = question_about(looking_at(pointer));
    look_at(pin_);
    look_at(end_);
    if (is_busy() && !is_wanted(*asked_, hovered)) answer_.interrupt();
  }
  draw_ring();
  if (has_plot) draw_pinned();
  if (hovered) draw_hovered(*hovered);
}

bool Pins::is_wanted(const Question& asked, const std::optional<Question>& hovered) const {
  const auto is_of = [&](const std::optional<Pin>& pin) { return pin && pin->looking == asked.looking; };
  return asked == hovered || is_of(pin_) || is_of(end_);
}

// Pins go before the pointer.
void Pins::look_at(std::optional<Pin>& pin) {
  if (!pin) return;
  const auto question = question_about(pin->looking);
  if (!question) return;
  if (const auto* answer = answer_to(*question)) {
    pin->asked = question;
    pin->pick = *answer;
    if (pin->pick) return;
    if (&pin == &end_) viewer_.messages.note("nothing is there: a line ends where something is");
    pin.reset();
  } else if (pin->asked != question) {
    ask(*question);
  }
}

// Shows the value beside the pointer.
void Pins::draw_hovered(const Question& question) {
  const auto* answer = answer_to(question);
  if (!answer) return ask(question);
  if (*answer) ImGui::SetTooltip("%s", words_of(**answer, *viewer_.session).c_str());
}

// Shows where the pinned value is.
void Pins::draw_ring() const {
  if (!pin_ || !pin_->pick) return;
  if (const auto at = viewer_.window_position(pin_->pick->position)) {
    const float scale = viewer_.scale();
    const ImVec2 center(static_cast<float>(at->x), static_cast<float>(at->y));
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const PictureArea area = viewer_.picture_area();
    list.PushClipRect({static_cast<float>(area.left), 0}, {static_cast<float>(area.left + area.width), 1e6f});
    list.AddCircle(center, 6 * scale, IM_COL32(0, 0, 0, 255), 24, 3 * scale);
    list.AddCircle(center, 6 * scale, IM_COL32(255, 255, 255, 255), 24, 1.5f * scale);
    list.PopClipRect();
  }
}

// Shows the pinned value and its plot in a window.
void Pins::draw_pinned() {
  if (!pin_ || !pin_->pick) return;
  const Pick& pick = *pin_->pick;
  const PictureArea area = viewer_.picture_area();
  const float scale = viewer_.scale();
  ImGui::SetNextWindowPos({static_cast<float>(area.left) + 8 * scale, static_cast<float>(area.height) - 8 * scale},
                          ImGuiCond_Appearing, {0, 1});
  bool stays = true;
  ImGui::Begin("pinned", &stays, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoCollapse);
  const Session& session = *viewer_.session;
  ImGui::TextUnformatted(words_of(pick, session).c_str());
  if (!pick.rows.empty()) draw_plot(pick, session.attribute());
  if (ImGui::SmallButton("copy"))
    ImGui::SetClipboardText(fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},{:.6g}\n", pick.position.x, pick.position.y,
                                        pick.position.z, pick.values.front().value, pick.opacity)
                                .c_str());
  hint("Copies x, y, z, the value and the opacity.");
  ImGui::SameLine();
  if (ImGui::SmallButton("copy plot")) ImGui::SetClipboardText(table_of(pick, session.attribute()).c_str());
  hint("Copies the table of distance, value and opacity.");
  ImGui::End();
  if (!stays) unpin();
}

}  // namespace splatvol
