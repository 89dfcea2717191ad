#include "viewer/file_dialog.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "base/byte_text.h"
#include "base/file.h"
#include "base/input_formats.h"
#include "base/printable.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

// What the viewer opens: volumes, indices of series, meshes, surfaces, scenes and colour maps.
bool is_opened(const std::string& name) {
  return name.ends_with(".svol") || name.ends_with(".svols") || name.ends_with(".json") || is_surface_file(name) ||
         is_input_in_folder(name);
}

}  // namespace

void FileDialog::open(const std::string& file) {
  std::error_code error;
  std::string folder = folder_.empty() ? "." : folder_;
  if (!file.empty() && !is_url(file)) folder = folder_of(file);
  is_open_ = is_new_ = true;
  is_closing_ = false;
  typed_[0] = 0;
  const fs::path absolute = fs::absolute(folder, error).lexically_normal();
  enter(error ? folder : absolute.string());
}

void FileDialog::enter(const std::string& folder) {
  folder_ = folder;
  entries_.clear();
  trouble_.clear();
  is_mesh_ = is_convertible(folder);
  std::error_code error;
  for (fs::directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
       !error && it != end; it.increment(error)) {
    std::error_code unknown;
    const std::string name = it->path().filename().string();
    const bool is_folder = it->is_directory(unknown);
    if (name.starts_with('.') || (!is_folder && !is_opened(name))) continue;
    entries_.push_back({name, is_folder, is_folder ? 0 : it->file_size(unknown)});
    if (unknown) entries_.back().bytes = 0;
  }
  if (error) trouble_ = fmt::format("{}: {}", folder, error.message());
  std::ranges::sort(entries_, [](const Entry& a, const Entry& b) {
    return a.is_folder != b.is_folder ? a.is_folder : a.name < b.name;
  });
}

// A folder is entered, anything else is the answer.
std::optional<std::string> FileDialog::choose(const std::string& path) {
  if (path.empty()) return {};
  std::error_code error;
  const std::string whole = is_url(path) ? path : (fs::path(folder_) / path).lexically_normal().string();
  if (!is_url(path) && fs::is_directory(whole, error)) {
    enter(whole);
    typed_[0] = 0;
    return {};
  }
  if (!is_url(path)) folder_ = folder_of(whole);
  is_open_ = false;
  return whole;
}

std::optional<std::string> FileDialog::draw_recent(std::span<const std::string> recent) {
  std::optional<std::string> chosen;
  if (recent.empty() || !ImGui::BeginCombo("##recent", "recent files")) return chosen;
  for (std::size_t i = 0; i < recent.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::Selectable(printable(recent[i]).c_str())) chosen = recent[i];
    ImGui::PopID();
  }
  ImGui::EndCombo();
  return chosen;
}

std::optional<std::string> FileDialog::draw_entries() {
  std::optional<std::string> chosen;
  ImGuiListClipper clipper;
  clipper.Begin(static_cast<int>(entries_.size()));
  while (clipper.Step())
    for (int i = clipper.DisplayStart; i < clipper.DisplayEnd; ++i) {
      const Entry& entry = entries_[static_cast<std::size_t>(i)];
      ImGui::PushID(i);
      if (ImGui::Selectable("##entry", false)) chosen = entry.name;
      ImGui::SameLine(0, 0);
      ImGui::TextUnformatted((printable(entry.name) + (entry.is_folder ? "/" : "")).c_str());
      if (!entry.is_folder) {
        const std::string size = byte_text(static_cast<double>(entry.bytes));
        ImGui::SameLine(ImGui::GetContentRegionMax().x - ImGui::CalcTextSize(size.c_str()).x);
        ImGui::TextUnformatted(size.c_str());
      }
      ImGui::PopID();
    }
  return chosen;
}

std::optional<std::string> FileDialog::draw(const WindowResized& window, std::span<const std::string> recent) {
  if (!is_open_) return {};
  constexpr const char* name = "open";
  if (is_new_) ImGui::OpenPopup(name);
  const float unit = gui_unit(), width = static_cast<float>(window.width), height = static_cast<float>(window.height);
  ImGui::SetNextWindowPos({width / 2, height / 2}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowSize({std::min(560 * unit, width), std::min(420 * unit, height)});
  if (!ImGui::BeginPopupModal(name, &is_open_, ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove)) return {};
  std::optional<std::string> chosen;
  ImGui::PushItemWidth(-1);
  if (is_new_) ImGui::SetKeyboardFocusHere();
  if (ImGui::InputTextWithHint("##path", "a path, or an address: https://... or ssh://...", typed_.data(),
                               typed_.size(), ImGuiInputTextFlags_EnterReturnsTrue))
    chosen = typed_.data();
  if (const auto listed = draw_recent(recent)) chosen = listed;
  ImGui::PopItemWidth();
  if (ImGui::SmallButton("up")) chosen = "..";
  ImGui::SameLine();
  ImGui::BeginDisabled(!is_mesh_);
  const bool takes_folder = ImGui::SmallButton("open the folder as one mesh");
  ImGui::EndDisabled();
  ImGui::SameLine();
  ImGui::TextUnformatted(printable(folder_).c_str());
  ImGui::BeginChild("entries", {0, -ImGui::GetFrameHeightWithSpacing()}, true);
  if (!trouble_.empty()) ImGui::TextWrapped("%s", trouble_.c_str());
  if (trouble_.empty() && entries_.empty())
    ImGui::TextUnformatted("nothing here that svview opens; a path above opens any file");
  if (const auto entry = draw_entries()) chosen = entry;
  ImGui::EndChild();
  if (ImGui::Button("open") && typed_[0]) chosen = typed_.data();
  ImGui::SameLine();
  if (ImGui::Button("cancel") || is_closing_) is_open_ = false;
  is_new_ = false;
  std::optional<std::string> file = chosen ? choose(*chosen) : std::nullopt;
  if (takes_folder) file = folder_, is_open_ = false;
  if (!is_open_) ImGui::CloseCurrentPopup();
  ImGui::EndPopup();
  return file;
}

}  // namespace splatvol
