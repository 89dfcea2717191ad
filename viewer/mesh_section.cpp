#include "viewer/mesh_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <filesystem>
#include <memory>
#include <system_error>

#include "base/temporary_names.h"
#include "player/conversion.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

// The copy appears whole or not at all.
Status copy_file(const std::string& from, const std::string& to) {
  namespace fs = std::filesystem;
  const std::string part = temporary_name_beside(to);
  note_temporary(part);
  std::error_code error;
  fs::copy_file(from, part, error);
  if (!error) fs::permissions(part, fs::perms::group_read | fs::perms::others_read, fs::perm_options::add, error);
  if (!error) fs::rename(part, to, error);
  std::error_code ignored;
  if (error) fs::remove(part, ignored);
  forget_temporary(part);
  return error ? Status(fail(ErrorCode::io, "{}: {}", to, error.message())) : Status{};
}

}  // namespace

bool MeshSection::draw() {
  const auto& converted = viewer_.session->converted();
  if (!converted) return false;
  name_.draw("volume");
  ImGui::BeginDisabled(is_saving());
  if (ImGui::SmallButton("save as .svol")) save_copy(name_.text());
  ImGui::EndDisabled();
  hint("Copies the file that the mesh became. It opens at once, also on other machines.");
  ImGui::SameLine();
  ImGui::BeginDisabled(!viewer_.session->times().empty());
  const bool all_steps = ImGui::SmallButton("all steps");
  ImGui::EndDisabled();
  hint("Reads all time steps of the mesh; so far there is the last one.");
  ImGui::SameLine();
  ImGui::BeginDisabled(converted->is_temporary);
  if (ImGui::SmallButton("forget")) forget();
  ImGui::EndDisabled();
  hint("Removes the file from svbuild's cache. The window shows it until you close it.");
  return all_steps;
}

void MeshSection::save_copy(const std::string& path) {
  if (!std::filesystem::path(path).extension().string().ends_with(".svol"))
    return viewer_.messages.error(path + ": does not end in .svol: give it that ending");
  save_.save(path, [this, path] {
    copy_ = path;
    // The lease keeps the file where it is until it is copied.
    const auto copy = [path, converted = *viewer_.session->converted()] { return copy_file(converted.path, path); };
    copied_ = {viewer_.host, copy};
  });
}

void MeshSection::draw_progress() {
  if (!is_saving()) return;
  if (copied_.wait())
    viewer_.messages.tell(copied_.take(), "saved " + copy_);
  else
    static_cast<void>(viewer_.messages.draw({.name = "copy", .text = "writing " + copy_}));
}

void MeshSection::forget() {
  const std::string path = viewer_.session->path();
  viewer_.messages.tell(viewer_.session->forget_converted(), path + ": the cache has forgotten it");
}

}  // namespace splatvol
