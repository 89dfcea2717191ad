// Exports streamlines of the vectors in the cells that a file keeps.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "format/volume.h"
#include "splatvol/streamlines.h"

namespace splatvol {

struct StreamlineReport {
  std::uint64_t seeds = 0;
  std::uint64_t lines = 0;                 // seeds outside of the field have none
  std::uint64_t rows = 0;                  // of all lines
  std::array<std::uint64_t, 6> ends = {};  // [StreamlineEnd]: ends of lines
  std::uint64_t file_bytes = 0;
  std::map<std::string, std::string> renamed = {};  // usual name: its name, where an attribute has the usual one
};

/// Writes the streamlines of a request (find_streamlines), as `path` says, in double precision.
/// - .vtp: a polyline each. Points have the time and the attributes, vectors as one array each; lines have the number
/// of
///   their seed, and why they begin and end, as numbers of StreamlineEnd.
/// - .csv: a row for each point: the number of the seed, the time, x, y, z and the attributes.
///
/// Holds all lines. Fails as find_streamlines does, if the request has two attributes of one name, or if `path` may not
/// be replaced: a table has no mark.
[[nodiscard]] Result<StreamlineReport> export_streamlines(const format::Volume& volume, const std::string& path,
                                                          const StreamlineRequest& request, std::uint64_t memory,
                                                          Replace replace = Replace::exports);

}  // namespace splatvol
