#include "builder/sources/vtk/channels.h"

#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkPointData.h>

#include <cmath>
#include <limits>

namespace splatvol {
namespace {

std::vector<double> read_channel(const VtkChannel& channel, vtkDataArray& array,
                                 std::span<const std::uint32_t> points) {
  std::vector<double> values(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    double value = 0;
    if (channel.component != VtkChannel::magnitude) {
      value = array.GetComponent(points[i], channel.component);
    } else {
      for (int c = 0; c < channel.components; ++c) value = std::hypot(value, array.GetComponent(points[i], c));
    }
    values[i] = std::isfinite(value) ? value : std::numeric_limits<double>::quiet_NaN();
  }
  return values;
}

}  // namespace

bool is_ghost_array(std::string_view name) { return name == "vtkGhostType" || name == "vtkGhostLevels"; }

bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name) {
  const int role = data.IsArrayAnAttribute(index);
  return is_ghost_array(name) || name.starts_with("vtkOriginal") || name == "vtkValidPointMask" || name == "IBlank" ||
         role == vtkDataSetAttributes::GLOBALIDS || role == vtkDataSetAttributes::PEDIGREEIDS;
}

std::vector<VtkChannel> channels_of(vtkDataSet& data) {
  std::vector<VtkChannel> channels;
  vtkPointData& arrays = *data.GetPointData();
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = arrays.GetArray(i);  // null for strings
    if (!array || !arrays.GetArrayName(i)) continue;
    const std::string name = arrays.GetArrayName(i);
    const int components = array->GetNumberOfComponents();
    if (is_bookkeeping(arrays, i, name)) continue;
    if (components == 1) {
      channels.push_back({name, name, 1, 0});
      continue;
    }
    channels.push_back({name, name, components, VtkChannel::magnitude});
    for (int c = 0; c < components; ++c) channels.push_back({fmt::format("{}[{}]", name, c), name, components, c});
  }
  return channels;
}

Result<std::vector<std::vector<double>>> read_channels(const std::string& path, vtkDataSet& data,
                                                       std::span<const VtkChannel> channels,
                                                       std::span<const std::uint32_t> points) {
  std::vector<std::vector<double>> values;
  for (const VtkChannel& channel : channels) {
    vtkDataArray* array = data.GetPointData()->GetArray(channel.array.c_str());
    if (!array || array->GetNumberOfComponents() != channel.components)
      return fail(ErrorCode::invalid_data, "{}: the array \"{}\" ({} components) of the first piece is not in this one",
                  path, channel.array, channel.components);
    if (array->GetNumberOfTuples() < data.GetNumberOfPoints())
      return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} values for {} points", path, channel.array,
                  array->GetNumberOfTuples(), data.GetNumberOfPoints());
    values.push_back(read_channel(channel, *array, points));
  }
  return values;
}

}  // namespace splatvol
