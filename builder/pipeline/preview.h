// A first file from some points of an input: something to look at while the build of all goes on.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "builder/pipeline/build.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Writes a preview of the first source that is read to its end. The preview has the attributes of the source, the same
/// box and ranges of values, and some of the points, which are joined as boxes. The points do not depend on the order
/// in which they are read. Holds a few times most_points points. Outlives its sources. Not thread-safe.
class Preview {
 public:
  static constexpr std::size_t most_points = 50'000;
  static constexpr std::uint64_t least_input = 100'000;  // a source of no more points gets no preview

  /// `path`: of the preview. `options`: those of the build. `done`: called once the preview is complete.
  Preview(std::string path, BuildOptions options, std::function<void(const std::string& path)> done);

  /// Returns the same source. Its next() writes the preview before it tells that there is no more piece, and fails if
  /// that fails.
  [[nodiscard]] std::unique_ptr<Source> watch(std::unique_ptr<Source> source);

 private:
  class WatchedSource;
  [[nodiscard]] Status write(Source& sample);

  std::string path_;
  BuildOptions options_;
  std::function<void(const std::string&)> done_;
  bool is_over_ = false;  // it is written, or not wanted
};

}  // namespace splatvol
