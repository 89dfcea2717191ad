#include "player/statistics.h"

#include <nlohmann/json.hpp>

namespace splatvol {
namespace {

using json = nlohmann::ordered_json;

// As in a scene file.
json lighting_of(const Scene& scene) {
  if (!scene.lighting) return false;
  return {{"ambient", scene.lighting->ambient}, {"diffuse", scene.lighting->diffuse}};
}

json statistics_of_exact(const Player& player) {
  const Scene& scene = player.scene();
  const format::Volume& volume = player.streamer().volume();
  return {{"file", volume.name()},
          {"attribute", scene.attribute},
          {"width", scene.width},
          {"height", scene.height},
          {"exact", true},
          {"lighting", lighting_of(scene)},
          {"sample_spacing", player.sample_spacing()},
          {"segments", player.exact()->segments},
          {"chunks", player.exact()->chunks},
          {"unknown_cells", player.exact()->unknown_cells},
          {"file_bytes", volume.file_bytes()},
          {"bytes_read", volume.bytes_read()},
          {"bytes_read_again", volume.bytes_read_again()},
          {"requests", volume.requests()},
          {"bytes_resident_peak", player.streamer().statistics().bytes_resident_peak}};
}

}  // namespace

json statistics_of(const Player& player) {
  if (player.exact()) return statistics_of_exact(player);
  const FrameSplats& frame = *player.frame();
  const Scene& scene = player.scene();
  const StreamerStatistics statistics = player.streamer().statistics();
  return {{"file", player.streamer().volume().name()},
          {"attribute", scene.attribute},
          {"width", scene.width},
          {"height", scene.height},
          {"kernel", name_of(kernel_of(player.options().drawing))},
          {"sort", name_of(player.sort())},
          {"lighting", lighting_of(scene)},
          {"sample_spacing", player.sample_spacing()},
          {"splats", frame.splats},
          {"nodes", frame.nodes},
          {"expected_error", frame.expected_error},
          {"resolution_histogram", frame.nodes_by_resolution},
          {"splats_by_resolution", frame.splats_by_resolution},
          {"file_bytes", player.streamer().volume().file_bytes()},
          {"bytes_read", statistics.bytes_read},
          {"bytes_read_again", statistics.bytes_read_again},
          {"requests", statistics.requests},
          {"bytes_resident_peak", statistics.bytes_resident_peak},
          {"gpu_bytes", player.rasterizer().device_bytes()},
          {"complete", frame.progress.complete},
          {"missing_rows", frame.progress.missing_rows},
          {"missing_pages", frame.progress.missing_pages},
          {"missing_bytes", frame.progress.missing_bytes},
          {"renderer", player.rasterizer().description()}};
}

json statistics_of(const ErrorSearch& search) {
  json document = {{"estimated_error", search.estimate.error},
                   {"error_by", search.estimate.measured ? "exact rays" : "finer pictures"},
                   {"file_error", search.estimate.file_error},
                   {"pictures_for_error", search.pictures}};
  for (const ErrorControl::Tried& tried : search.tried)
    document["tried_for_error"].push_back({{"splats", tried.splats},
                                           {"sample_spacing", tried.sample_spacing},
                                           {"estimated_error", tried.error},
                                           {"estimated_milliseconds", 1e-6 * tried.work}});
  return document;
}

}  // namespace splatvol
