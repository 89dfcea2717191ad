// svbuild IN... --cached: a file from the cache, built if it is not there.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/process/reader_process.h"
#include "tools/build_share.h"
#include "tools/command_line.h"

namespace splatvol {

struct CacheOptions {
  bool cached = false;
  bool list = false;
  bool forget = false;
  bool progress = false;
  std::string preview;  // empty: none
};

void add_cache_options(CommandLine& app, CacheOptions& options);

/// Shows how far a build is. May be called from any thread, one at a time.
using ShowShare = std::function<void(const BuildShare::State&)>;

/// What the cache needs to know of a build.
struct CachedBuild {
  std::vector<std::string> inputs;
  std::string choices;  // the options that the file depends on, as a text
  std::string name;     // of the file
  bool json = false;    // without progress: how the result is printed

  /// What a build tells.
  struct Outcome {
    std::vector<std::string> notes;
    ReadFiles read;
  };
  /// Builds the file `output`. `show_preview` gets the path of the preview once it is complete.
  std::function<Result<Outcome>(const std::string& output, const ShowShare& show,
                                const std::function<void(const std::string&)>& show_preview)>
      build;
};

/// Finds or builds the file, and prints where it is. With progress, prints lines of JSON, and waits for the end of the
/// standard input before it lets go of the file.
[[nodiscard]] Status build_cached(const CacheOptions& options, const CachedBuild& build);

/// Prints what the cache holds.
[[nodiscard]] Status list_cache(bool json);

/// Removes the entries of some inputs, or all.
[[nodiscard]] Status forget_in_cache(const std::vector<std::string>& inputs);

}  // namespace splatvol
