// The scalars that a VTK data set has at its points.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

class vtkDataSet;
class vtkDataSetAttributes;

namespace splatvol {

/// A scalar of a point: an array, its component, or its magnitude.
struct VtkChannel {
  static constexpr int magnitude = -1;
  std::string name;
  std::string array;
  int components = 1;
  int component = 0;
};

/// Whether an array of this name says which points or cells are copies or hidden.
[[nodiscard]] bool is_ghost_array(std::string_view name);

/// Whether array `index` of this name is one that VTK or a filter made for its own books.
[[nodiscard]] bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name);

/// All scalars of a data set, in the order of its arrays; none for strings, ghost flags, ids and the like.
[[nodiscard]] std::vector<VtkChannel> channels_of(vtkDataSet& data);

/// The values of `channels` at `points`, as Piece::values has them. Fails where a channel's array is not there, has
/// another number of components, or is too short; `path` begins the message. Requires points in range.
[[nodiscard]] Result<std::vector<std::vector<double>>> read_channels(const std::string& path, vtkDataSet& data,
                                                                     std::span<const VtkChannel> channels,
                                                                     std::span<const std::uint32_t> points);

}  // namespace splatvol
