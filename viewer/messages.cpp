#include "viewer/messages.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <ranges>

#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr std::size_t most_toasts = 3;  // of messages
constexpr int most_lines = 5;           // of a toast: the list has the rest
constexpr float gap = 4, bar = 6;       // between toasts, and height of the bar of work, at scale 1
constexpr unsigned error_color = IM_COL32(225, 70, 60, 255), note_color = IM_COL32(80, 150, 240, 255);

std::string with_times(const Messages::Message& message) {
  return message.times > 1 ? fmt::format("{} ({}x)", message.text, message.times) : message.text;
}

float height_of(const std::string& text, float width) {
  return ImGui::CalcTextSize(text.c_str(), nullptr, false, width).y;
}

// Cuts a text off where it takes more lines than a toast has, but not within a character.
std::string cut_off(const std::string& text, float width) {
  const std::string end = " ... (M)";
  const float most = static_cast<float>(most_lines) * ImGui::GetTextLineHeight() + 1;
  if (height_of(text, width) <= most) return text;
  std::size_t fits = 0, beyond = text.size();
  while (beyond - fits > 1) {
    const std::size_t middle = fits + (beyond - fits) / 2;
    (height_of(text.substr(0, middle) + end, width) <= most ? fits : beyond) = middle;
  }
  while (fits > 0 && (static_cast<unsigned char>(text[fits]) & 0xC0) == 0x80) --fits;
  return text.substr(0, fits) + end;
}

std::string words_of_bar(const Messages::Work& work) {
  std::string text = fmt::format("{:.0f} %", 100 * *work.share);
  if (!work.seconds_left) return text;
  const double seconds = *work.seconds_left;
  return text + (seconds < 100 ? fmt::format(", {:.0f} s left", seconds)
                               : fmt::format(", {:.0f} min left", std::ceil(seconds / 60)));
}

Messages::Work toast_of(const Messages::Message& message) {
  if (!message.buttons.empty())
    return {.name = "message " + message.text, .text = message.text, .buttons = message.buttons};
  return {.name = "message " + message.text, .text = with_times(message), .buttons = {"x"}};
}

}  // namespace

// In window units.
struct Messages::Layout {
  std::string text;
  float text_width;   // where it wraps
  float buttons = 0;  // width, with the space before each
  ImVec2 size;
};

void Messages::tell(const Status& tried, const std::string& done) { tried ? note(done) : error(tried.error().message); }

void Messages::ask(const std::string& text, std::vector<std::string> buttons) {
  end_question();
  add(text, false).buttons = std::move(buttons);
}

void Messages::end_question() {
  has_changed_ |= std::erase_if(toasts_, [](const auto& toast) { return !toast.second->buttons.empty(); }) > 0;
}

Messages::Message& Messages::add(const std::string& text, bool is_error) {
  Message& message = messages_[text];
  all_.erase(message.number);
  toasts_.erase(message.number);
  message.text = text;
  message.is_error = is_error;
  ++message.times;
  message.number = take_number();
  message.seconds_left = note_seconds;
  all_[message.number] = toasts_[message.number] = &message;
  has_changed_ = true;
  return message;
}

std::vector<Messages::Message> Messages::copies_of(const ByNumber& messages) {
  std::vector<Message> copies;
  for (const Message* message : messages | std::views::values) copies.push_back(*message);
  return copies;
}

void Messages::close(std::uint64_t number) { has_changed_ |= toasts_.erase(number) > 0; }

std::uint64_t Messages::newest_error() const {
  for (const auto& [number, message] : toasts_ | std::views::reverse)
    if (message->is_error) return number;
  return 0;
}

void Messages::toggle_list() {
  is_list_open_ = !is_list_open_;
  if (is_list_open_) toasts_.clear();
  has_changed_ = true;
}

void Messages::advance(double seconds) {
  if (is_held_) return;
  has_changed_ |= std::erase_if(toasts_, [&](const auto& toast) {
                    Message& message = *toast.second;
                    return !message.is_error && (message.seconds_left -= seconds) <= 0;
                  }) > 0;
}

std::optional<double> Messages::seconds_to_change() const {
  std::optional<double> least;
  for (const Message* message : toasts_ | std::views::values)
    if (!is_held_ && !message->is_error) least = std::min(least.value_or(note_seconds), message->seconds_left);
  return least;
}

void Messages::begin(const PictureArea& area, bool has_axes, float top) {
  const float unit = gui_unit(), height = static_cast<float>(area.height);
  const float border = 8 * unit, axes = 114 * unit;
  area_ = area;
  bottom_ = std::max(height - (has_axes ? axes : border), std::min(height - border, 40 * unit));
  top_ = std::max(top + border, 0.42f * height);
  has_toast_ = false;
}

// The scalar bar is at the right.
Messages::Layout Messages::lay_out(const Work& work) const {
  const ImGuiStyle& style = ImGui::GetStyle();
  const float unit = gui_unit(), width = static_cast<float>(area_.width) - 16 * unit;
  const float widest = std::min({width, 480 * unit, std::max(width - 90 * unit, 240 * unit)});
  Layout layout{.text = {}, .text_width = 0, .size = {}};
  for (const std::string& button : work.buttons)
    layout.buttons += style.ItemSpacing.x + ImGui::CalcTextSize(button.c_str()).x + 2 * style.FramePadding.x;
  const float besides = layout.buttons + 2 * style.WindowPadding.x;
  layout.text_width = std::floor(std::max(widest - besides, 40 * unit));
  layout.text = cut_off(work.text, layout.text_width) + (work.share ? "\n" + words_of_bar(work) : "");
  const ImVec2 text = ImGui::CalcTextSize(layout.text.c_str(), nullptr, false, layout.text_width);
  layout.size = {text.x + besides, text.y + 2 * style.WindowPadding.y};
  if (work.share) {
    layout.size.x = std::max(layout.size.x, std::min(widest, 240 * unit));
    layout.size.y += style.ItemSpacing.y + bar * unit;
  }
  layout.size.y = std::max(layout.size.y, style.WindowMinSize.y);
  return layout;
}

std::optional<std::size_t> Messages::draw(const Work& work) { return draw(work, note_color); }

std::optional<std::size_t> Messages::draw(const Work& work, unsigned color) {
  const Layout layout = lay_out(work);
  const float unit = gui_unit();
  const ImVec2 at(static_cast<float>(area_.left) + 8 * unit, bottom_ - layout.size.y);
  ImGui::SetNextWindowPos(at);
  ImGui::SetNextWindowSize(layout.size);
  ImGui::SetNextWindowBgAlpha(0.95f);
  ImGui::PushStyleColor(ImGuiCol_Border, color);
  ImGui::Begin(("##" + work.name).c_str(), nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav |
                   ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoScrollWithMouse);
  ImGui::PopStyleColor();
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.PushClipRect(at, {at.x + layout.size.x, at.y + layout.size.y});
  list.AddRectFilled(at, {at.x + 4 * unit, at.y + layout.size.y}, color, ImGui::GetStyle().WindowRounding,
                     ImDrawFlags_RoundCornersLeft);
  list.PopClipRect();
  ImGui::PushTextWrapPos(ImGui::GetCursorPosX() + layout.text_width);
  ImGui::TextUnformatted(layout.text.c_str());
  ImGui::PopTextWrapPos();
  std::optional<std::size_t> pressed;
  float x = layout.size.x - ImGui::GetStyle().WindowPadding.x - layout.buttons;
  for (std::size_t i = 0; i < work.buttons.size(); ++i) {
    const float spacing = ImGui::GetStyle().ItemSpacing.x;
    ImGui::SameLine(x += spacing);
    if (ImGui::SmallButton(work.buttons[i].c_str())) pressed = i;
    x += ImGui::GetItemRectSize().x;
  }
  if (work.share) {
    ImGui::PushStyleColor(ImGuiCol_PlotHistogram, color);
    ImGui::ProgressBar(static_cast<float>(std::clamp(*work.share, 0.0, 1.0)), {-1, bar * unit}, "");
    ImGui::PopStyleColor();
  }
  ImGui::End();
  bottom_ = at.y - gap * unit;
  has_toast_ = true;
  return pressed;
}

// The newest messages that there is room for, the oldest of them lowest: they stay in their places when others come.
std::optional<std::size_t> Messages::draw() {
  const Work more{.name = "more", .text = fmt::format("and {} more", toasts_.size()), .buttons = {"show all (M)"}};
  const auto taken_by = [&](const Work& work) { return lay_out(work).size.y + gap * gui_unit(); };
  float room = bottom_ - top_;
  std::vector<const Message*> shown;
  for (const Message* message : toasts_ | std::views::values | std::views::reverse) {
    const float besides = shown.size() + 1 < toasts_.size() ? taken_by(more) : 0;
    const float taken = taken_by(toast_of(*message));
    if ((has_toast_ || !shown.empty()) && (taken + besides > room || shown.size() == most_toasts)) break;
    room -= taken;
    shown.push_back(message);
  }
  bool shows_all = false;
  if (const std::size_t hidden = toasts_.size() - shown.size(); hidden > 0)
    shows_all = draw({more.name, fmt::format("and {} more", hidden), more.buttons}, note_color).has_value();
  std::optional<std::size_t> answer;
  for (const Message* message : shown | std::views::reverse) {
    const auto pressed = draw(toast_of(*message), message->is_error ? error_color : note_color);
    if (!pressed) continue;
    if (!message->buttons.empty()) answer = pressed;
    close(message->number);
  }
  if (shows_all) toggle_list();
  if (is_list_open_) draw_list();
  return answer;
}

void Messages::draw_list() {
  const float unit = gui_unit(), border = 16 * unit;
  const ImVec2 area(static_cast<float>(area_.width), static_cast<float>(area_.height));
  ImGui::SetNextWindowPos({static_cast<float>(area_.left) + area.x / 2, area.y / 2}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowSize({std::min(area.x - border, 560 * unit), std::min(area.y - border, 360 * unit)});
  ImGui::SetNextWindowBgAlpha(0.95f);
  ImGui::Begin("messages", &is_list_open_,
               ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize);
  if (all_.empty()) ImGui::TextUnformatted("There is none so far.");
  std::string copied;
  if (!all_.empty() && ImGui::SmallButton("copy all"))
    for (const Message* message : all_ | std::views::values) copied += with_times(*message) + "\n";
  if (!copied.empty()) ImGui::SetClipboardText(copied.c_str());
  ImGui::BeginChild("list");
  for (const Message* message : all_ | std::views::values | std::views::reverse) {
    ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(message->is_error ? error_color : note_color), "%s",
                       message->is_error ? "error" : "note");
    ImGui::SameLine(48 * unit);
    ImGui::PushTextWrapPos(0);
    ImGui::TextUnformatted(with_times(*message).c_str());
    ImGui::PopTextWrapPos();
  }
  ImGui::EndChild();
  ImGui::End();
}

}  // namespace splatvol
