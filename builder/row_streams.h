// Rows of all resolutions at once, as a pass over the points brings them, put into file order.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "base/temp_file.h"
#include "builder/cascade.h"
#include "builder/density.h"
#include "builder/splat_rows.h"
#include "format/volume_info.h"

namespace splatvol {

/// Collects the points of each segment and their splats at each step, packs them and keeps them in temporary files: one
/// for each pair, so that each is read from its beginning to its end.
/// The densities of steps with at most `fitted_splats` splats are fitted (density.h), which needs all of them at once;
/// others are packed as they come.
class RowStreams {
 public:
  /// `info`: attributes, columns and points_per_chunk; not what is only known at the end. `folder`: for the files.
  RowStreams(const format::VolumeInfo& info, std::uint64_t fitted_splats, std::string folder);

  /// The next splat of a step, in Morton order; `first_part`: see Cascade.
  void add_splat(std::size_t step, const SplatRow& splat, std::uint64_t first_part);

  /// Says beforehand that a step will have too many splats; they need not be added then.
  void leave_unfitted(std::size_t step) { fit(step).wanted = false; }

  /// The next points of segment 0, with their splats at step 0.
  void add_finest(const SplatRows& rows);

  /// The next point of a segment, with its splats at all steps that draw it.
  void add_point(std::size_t segment, const Member& member);

  /// Packs what is complete. Once in a while is enough.
  [[nodiscard]] Status pack();

  /// Fits and packs the rest; `steps`: how many there are.
  [[nodiscard]] Status finish(std::size_t steps);

  /// Gets the entries of a row's chunks and their bytes, which lie side by side.
  using Visit = std::function<Status(std::span<const format::ChunkEntry>, std::span<const std::byte>)>;

  /// Visits each row in file order, and gives its disk space back. After finish.
  [[nodiscard]] Status read(const Visit& visit);

 private:
  /// What a step's fit needs. Not kept for steps with too many splats.
  struct Fit {
    bool wanted = true;
    std::vector<PlacedShape> shapes;    // [splat]
    std::vector<std::uint64_t> begins;  // [splat]: of its parts among the next finer step's splats
  };
  struct Extent {
    std::uint64_t offset, bytes;
  };
  struct Stream {
    std::deque<SplatRows> rows;  // not packed yet: chunks, of which only the last may be smaller than others
    TempFile* file = nullptr;    // once there is something in it
    std::vector<Extent> packed;  // rows in the file
  };

  std::vector<Stream>& streams(std::size_t segment);
  SplatRows& open_chunk(Stream& stream);
  Fit& fit(std::size_t step);
  void fit_step(std::size_t step);
  [[nodiscard]] Status pack(bool at_end);
  [[nodiscard]] Status append(Stream& stream, std::span<const std::byte> row);
  [[nodiscard]] const std::vector<format::Column>& columns(std::size_t step, std::size_t segment) const {
    return step == segment ? all_columns_ : resolution_columns_;
  }

  std::vector<format::Attribute> attributes_;
  std::vector<format::Column> all_columns_, resolution_columns_;
  std::size_t points_per_chunk_;
  std::uint64_t fitted_splats_;
  std::string folder_;
  std::deque<TempFile> files_;
  std::vector<std::vector<Stream>> streams_;  // [segment][step]
  std::vector<SplatRows> spare_;              // empty ones, whose memory the next chunks take
  std::vector<Fit> fits_;                     // [step]
};

}  // namespace splatvol
