// Meshes that become .svol files aside: svbuild converts them, and keeps the files in its cache.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "format/steps.h"

namespace splatvol {

struct ConversionRequest {
  std::vector<std::string> inputs;  // as svbuild takes them
  bool all_steps = false;           // of an input with time steps; else the last one
  std::string preview = {};         // a file that svbuild writes first, of some of the points; empty: none
};

/// How far a conversion is.
struct ConversionProgress {
  std::string stage = {};                   // a word for people
  double share = 0;                         // of all, 0 to 1
  std::optional<double> seconds_left = {};  // none: not known
  bool has_preview = false;                 // the file of the request is there
};

struct ConvertedFile {
  std::string path = {};                // of the .svol or .svols file
  bool was_built = false;               // else the cache had it
  bool is_temporary = false;            // there is no cache
  std::vector<std::string> notes = {};  // lines for the user
  // While it lives, svbuild does not remove the file.
  std::shared_ptr<const void> lease = {};
};

/// Whether files are a mesh or points that svbuild may convert, by their names; a mesh may be in several files.
[[nodiscard]] bool needs_conversion(const std::vector<std::string>& files);

/// Returns the path of svbuild: beside this program if it is there, else its name, which PATH finds.
[[nodiscard]] std::string usual_svbuild();

/// Converts an input, or finds it in the cache. `tell`, if there is one, is called on this thread. Heeds an
/// Interruptible: svbuild is interrupted then, and leaves nothing. Fails if there is no svbuild, and as it does.
[[nodiscard]] Result<ConvertedFile> convert(const ConversionRequest& request,
                                            const std::function<void(const ConversionProgress&)>& tell,
                                            const std::string& svbuild = usual_svbuild());

/// Returns a function that opens the converted file as `open` does, but by the name of the mesh: messages tell that.
[[nodiscard]] format::OpenFile open_as(const std::string& mesh, const ConvertedFile& converted, format::OpenFile open);

/// Removes what the cache has of an input, unless somebody has its file open. Fails if there is no svbuild, or it
/// fails.
[[nodiscard]] Status forget_converted(const std::vector<std::string>& inputs,
                                      const std::string& svbuild = usual_svbuild());

}  // namespace splatvol
