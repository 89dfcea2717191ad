#include "builder/sources/plot3d/plot3d_reader.h"

#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockPLOT3DReader.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkStructuredGrid.h>

#include <algorithm>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/loaded_data_sets.h"
#include "builder/sources/plot3d/plot3d_format.h"
#include "builder/sources/vtk/data_set.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

/// Appends all structured grids of a tree of blocks.
void collect_blocks(vtkMultiBlockDataSet& tree, std::vector<vtkSmartPointer<vtkDataSet>>& blocks) {
  for (unsigned int i = 0; i < tree.GetNumberOfBlocks(); ++i) {
    vtkDataObject* block = tree.GetBlock(i);
    if (auto* grid = vtkStructuredGrid::SafeDownCast(block)) blocks.emplace_back(grid);
    if (auto* branch = vtkMultiBlockDataSet::SafeDownCast(block)) collect_blocks(*branch, blocks);
  }
}

/// The arrays that every solution gives.
std::vector<ArrayShape> plot3d_arrays() {
  return {{"Density", 1, false}, {"Momentum", 3, false}, {"StagnationEnergy", 1, false}, {"Pressure", 1, false}};
}

/// Adds the functions of a PLOT3D file to the blocks of its grid.
Status add_functions(const std::string& path, ByteSource& file, const Plot3dFormat& format,
                     std::span<const vtkSmartPointer<vtkDataSet>> blocks) {
  for (std::size_t block = 0; block < blocks.size(); ++block) {
    SPLATVOL_TRY_ASSIGN(names, plot3d_function_names(path, format.functions[block].count));
    for (std::size_t function = 0; function < names.size(); ++function) {
      SPLATVOL_TRY_ASSIGN(values, read_plot3d_function(file, format, block, function));
      const vtkNew<vtkDoubleArray> array;
      array->SetName(names[function].c_str());
      array->SetNumberOfValues(static_cast<vtkIdType>(values.size()));
      std::ranges::copy(values, array->GetPointer(0));
      blocks[block]->GetPointData()->AddArray(array);
    }
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<DataSets>> open_plot3d(const InputFile& file, const SourceOptions& /*options*/) {
  const auto& [grid, values] = std::tie(file.path, file.values);
  // VTK can guess the variant from the grid's size, but it reads past the end of a truncated file's dimensions.
  SPLATVOL_TRY_ASSIGN(grid_file, open_file(grid));
  SPLATVOL_TRY_ASSIGN(values_file, open_file(values));
  SPLATVOL_TRY_ASSIGN(format, detect_plot3d(*grid_file, *values_file));
  constexpr int pressure = 110;
  const bool has_solution = format.functions.empty();
  std::vector<vtkSmartPointer<vtkDataSet>> blocks;
  SPLATVOL_TRY(run_vtk(grid, [&] {
    const vtkNew<vtkMultiBlockPLOT3DReader> reader;
    reader->SetXYZFileName(grid.c_str());
    if (has_solution) reader->SetQFileName(values.c_str());
    reader->SetMultiGrid(format.multi_grid);
    reader->SetHasByteCount(format.record_marks);
    reader->SetByteOrder(format.big_endian ? vtkMultiBlockPLOT3DReader::FILE_BIG_ENDIAN
                                           : vtkMultiBlockPLOT3DReader::FILE_LITTLE_ENDIAN);
    reader->SetIBlanking(format.blanking);
    reader->SetTwoDimensionalGeometry(format.dimensions == 2);
    reader->SetDoublePrecision(format.precision == 8);
    reader->ForceReadOn();
    if (has_solution) reader->AddFunction(pressure);
    reader->Update();
    if (reader->GetOutput()) collect_blocks(*reader->GetOutput(), blocks);
  }));
  if (blocks.empty()) return fail(ErrorCode::invalid_data, "{}: the PLOT3D grid has no blocks", grid);
  if (!has_solution && blocks.size() != format.functions.size())
    return fail(ErrorCode::invalid_data, "{}: VTK's reader finds {} of its {} blocks", grid, blocks.size(),
                format.functions.size());
  if (!has_solution) SPLATVOL_TRY(add_functions(values, *values_file, format, blocks));
  std::vector<std::unique_ptr<DataSet>> data;
  for (const auto& block : blocks) data.push_back(data_set_of(*block));
  auto data_sets = std::make_unique<LoadedDataSets>(grid, std::move(data));
  if (has_solution) data_sets->declare(plot3d_arrays());
  return data_sets;
}

}  // namespace splatvol
