#include "viewer/hud.h"

#include <fmt/format.h>
#include <imgui.h>

#include "base/byte_text.h"

namespace splatvol {
namespace {

// Tells what is in the picture.
std::string drawn_text(const Session& session) {
  if (const auto& exact = session.exact())
    return fmt::format("{} segments of rays, in {} chunks of cells\n", exact->segments, exact->chunks);
  const FrameSplats& frame = *session.frame();
  std::string text = fmt::format("{} points as {} splats\n", session.info().point_count(),
                                 session.shown_recipe().recipe.most_splats());
  for (std::size_t r = 0; r < frame.splats_by_resolution.size(); ++r)
    if (frame.splats_by_resolution[r] > 0)
      text += fmt::format("  resolution {}: {} splats in {} nodes\n", r, frame.splats_by_resolution[r],
                          frame.nodes_by_resolution[r]);
  return text;
}

std::string error_text(const ShownRecipe& recipe) {
  return fmt::format("error {:.1g} {}", recipe.error, recipe.is_measured ? "measured" : "expected");
}

// Tells how fine the picture is that is shown, and why it is not finer.
std::string detail_text(const Session& session) {
  const ShownRecipe& shown = session.shown_recipe();
  if (shown.recipe.is_exact()) {
    const int spacing = shown.recipe.sample_spacing;
    if (spacing == 1) return "exact";
    const std::string text = fmt::format("exact, samples {} apart", spacing);
    if (shown.moves) return text + ", " + error_text(shown);
    return session.is_settled() ? text : text + ": it sharpens";
  }
  const FrameSplats& frame = *session.frame();
  const auto& refinement = session.refinement();
  if (shown.moves) return error_text(shown);
  if (!refinement) return "it moves";
  const Detail& asked = refinement->detail();
  if (asked.resolution) return fmt::format("resolution {}", frame.detail.resolution.value_or(*asked.resolution));
  if (!asked.goal) {
    const double drawn = frame.detail.tolerance_percent;
    const bool lacks = !frame.detail.goal && drawn > asked.tolerance_percent;
    return (asked.tolerance_percent > 0 ? fmt::format("tolerance {:.3g} %", asked.tolerance_percent) : "all points") +
           (lacks ? fmt::format(" (memory allows a tolerance of {:.3g} %)", drawn) : "");
  }
  if (!refinement->seeks_error()) return fmt::format("an error of about {:.1g} expected", frame.expected_error);
  const std::string error = refinement->error() ? fmt::format("an error of about {:.2g}", *refinement->error()) : "";
  if (!refinement->is_done()) return (error.empty() ? "" : error + ", ") + "it sharpens";
  if (frame.finest) return "no more points would show";
  return error + (refinement->has_reached() ? "" : ": memory allows no less");
}

}  // namespace

float draw_hud(ViewerState& viewer, double frame_seconds) {
  const Session& session = *viewer.session;
  const bool is_of_cells = session.exact() && session.shown_recipe().recipe.is_exact();
  if (!session.frame() && !is_of_cells) return 0;
  const StreamerStatistics statistics = session.statistics();
  const auto bytes = [](std::uint64_t count) { return byte_text(static_cast<double>(count)); };
  const FrameProgress progress = is_of_cells ? FrameProgress() : session.frame()->progress;
  std::string text = fmt::format("{:.0f} frames/s, picture {:.1f} ms\n", frame_seconds > 0 ? 1 / frame_seconds : 0,
                                 1000 * session.draw_seconds());
  text += drawn_text(session);
  text += detail_text(session) + "\n";
  text += fmt::format("{} of {} in use, and {} to draw\n", bytes(statistics.bytes_resident),
                      bytes(session.settings.memory), bytes(session.device_bytes()));
  const std::string device = session.device_text(), name = device.substr(0, device.find(','));
  const bool is_open = name.find('(') != std::string::npos && name.find(')') == std::string::npos;
  text += session.shown_recipe().recipe.is_exact() ? "drawn by the processor\n"
                                                   : fmt::format("drawn by {}{}\n", name, is_open ? ")" : "");
  const std::uint64_t again = statistics.bytes_read_again;
  text +=
      fmt::format("{} of {} read{}, {} requests\n", bytes(statistics.bytes_read - again), bytes(session.file_bytes()),
                  again > 0 ? fmt::format(", {} again", bytes(again)) : "", statistics.requests);
  text += fmt::format("{} parts pending ({})", progress.missing_rows + progress.missing_pages,
                      bytes(progress.missing_bytes));
  const std::vector<double>& times = session.times();
  if (times.size() > 1)
    text += fmt::format("\nstep {} (0 to {}), time {:.6g}", session.step(), times.size() - 1, times[session.step()]);
  const float scale = viewer.scale();
  if (const auto& troubles = session.troubles(); !troubles.empty())
    text += fmt::format("\nerrors: {}", troubles.size());
  // Where it would hide most of the picture, or the button of the panel, there are no numbers.
  const ImVec2 size = ImGui::CalcTextSize(text.c_str());
  const float room = static_cast<float>(viewer.picture_area().width) - (viewer.is_narrow() ? 120 : 32) * scale;
  if (viewer.panel() && viewer.is_narrow()) return 0;
  if (size.x > room || size.y > static_cast<float>(viewer.picture_area().height) / 2) return 0;
  const float right = static_cast<float>(viewer.picture_area().left + viewer.picture_area().width);
  ImGui::SetNextWindowPos({right - 8 * scale, 8 * scale}, ImGuiCond_Always, {1, 0});
  ImGui::SetNextWindowBgAlpha(0.75f);
  ImGui::Begin("HUD", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav);
  ImGui::TextUnformatted(text.c_str());
  const float bottom = ImGui::GetWindowPos().y + ImGui::GetWindowHeight();
  ImGui::End();
  return bottom;
}

void draw_keys(ViewerState& viewer) {
  constexpr double widest = 560;  // at scale 1
  const PictureArea area = viewer.picture_area();
  const bool fits = area.width >= widest * viewer.window.content_scale;
  const double middle = fits ? area.left + area.width / 2 : viewer.window.width / 2.0;
  ImGui::SetNextWindowPos({static_cast<float>(middle), static_cast<float>(viewer.window.height) / 2}, ImGuiCond_Always,
                          {0.5f, 0.5f});
  ImGui::Begin("keys", &viewer.shown.help, ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_AlwaysAutoResize);
  constexpr std::pair<const char*, const char*> lines[] = {
      {"left drag", "turn"},
      {"right drag, shift", "move"},
      {"control drag", "roll"},
      {"wheel", "zoom to the pointer; with shift, or sideways: move"},
      {"click", "pin the value and its plot along the line of sight"},
      {"shift click", "end a line from the pin there"},
      {"R", "see all again"},
      {"1 2 3 4", "from +x, +y, +z, a corner; with shift from the other side"},
      {"N", "along the normal of the selected plane"},
      {"P", "perspective or orthographic"},
      {"F", "fly: W A S D E Q, arrows and left drag to look, shift for speed"},
      {"L", "lighting"},
      {"X", "add a slice; drag its balls to move and turn it"},
      {"space", "play the steps of a time series, or stop"},
      {"left, right", "step before, next step"},
      {"B C H", "bounding box, octree cut, numbers"},
      {"Tab", "panel"},
      {"control Z", "undo; with shift, or control Y: redo"},
      {"control O, W", "open a file, close it"},
      {"control C", "copy a command that shows the same"},
      {"M", "all messages so far"},
      {"Esc", "end what began last: reading, a movie, a pin, a line, an error, a list"},
      {"F1", "this list"},
      {"control Q", "quit"},
  };
  if (ImGui::BeginTable("keys", 2, ImGuiTableFlags_SizingFixedFit)) {
    for (const auto& [keys, what] : lines) {
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(keys);
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(what);
    }
    ImGui::EndTable();
  }
  ImGui::TextUnformatted(
      "Drop a mesh or a .svol file to open it,\na scene or ParaView's colour maps (.json) to apply them.");
  ImGui::End();
}

}  // namespace splatvol
