// Contours that become files of other programs aside: svexport writes them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "base/error.h"

namespace splatvol {

struct ContourExportRequest {
  std::string file;                 // a .svol or .svols file, or an address
  std::optional<std::size_t> step;  // of a time series
  std::string attribute;
  double value = 0;
  std::string output;     // .vtp, .stl or .glb
  bool replaces = false;  // whatever file is there; else only what svexport wrote
};

/// Returns the path of svexport: beside this program if it is there, else its name, which PATH finds.
[[nodiscard]] std::string usual_svexport();

/// Writes a contour, and returns the number of its triangles. `tell` is called on this thread with the share that is
/// done. Heeds an Interruptible: svexport is interrupted then, and leaves nothing. Fails if there is no svexport, and
/// as it does.
[[nodiscard]] Result<std::uint64_t> export_contour_aside(const ContourExportRequest& request,
                                                         const std::function<void(double)>& tell,
                                                         const std::string& svexport = usual_svexport());

}  // namespace splatvol
