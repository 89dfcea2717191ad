// The streamlines of a scene, as tubes.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/memory_budget.h"
#include "base/part_table.h"
#include "format/volume.h"
#include "player/player_memory.h"
#include "renderer/surfaces/surface.h"
#include "sampler/streamlines.h"
#include "scene/scene.h"

namespace splatvol {

/// Where streamlines are followed.
struct StreamlineFile {
  std::shared_ptr<const format::Volume> volume;  // at its step
  std::shared_ptr<PlayerMemory> memory;
  PartRoom room;  // of the file, in this memory
};

/// Streamlines of a scene with their tubes. Not shown: without lines and triangles.
struct SceneTubes {
  SceneStreamlines of;
  std::uint64_t step_key = 0;
  Surface surface;                                       // of the tubes; as its file it has a name for picks
  std::shared_ptr<const std::vector<Streamline>> lines;  // that have rows; null: they are not followed
  std::size_t seeds = 0;                                 // of the lines
  std::shared_ptr<const StreamlineFile> file = nullptr;  // before what needs it
  std::shared_ptr<const VectorField> field = nullptr;    // with the chunks that it read
  std::shared_ptr<const Reservation> room = nullptr;     // of lines and tubes
};

/// Calls it with what is there so far.
using TakeTubes = std::function<void(std::vector<SceneTubes>)>;

/// Follows the streamlines of a scene that are shown, and makes tubes of them. Takes lines over that `before` has.
/// `take`: called now and then while lines are followed, on any thread, one call at a time; none: not called. Lines and
/// tubes have a part of PlayerMemory::streamlines, which has room for those that are shown as well. Fails as
/// find_streamlines does, and with out_of_budget if they take more. Heeds an Interruptible.
[[nodiscard]] Result<std::vector<SceneTubes>> read_scene_streamlines(std::span<const SceneStreamlines> streamlines,
                                                                     const StreamlineFile& file,
                                                                     std::span<const SceneTubes> before,
                                                                     const TakeTubes& take = {});

}  // namespace splatvol
