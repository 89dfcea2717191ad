#include "builder/sources/vtk/plot3d_reader.h"

#include <vtkDataSet.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockPLOT3DReader.h>
#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtkStructuredGrid.h>

#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/plot3d_format.h"

namespace splatvol {
namespace {

/// Blocks that are all in memory.
class Plot3dDataSets final : public VtkDataSets {
 public:
  Plot3dDataSets(std::string grid, std::vector<vtkSmartPointer<vtkDataSet>> blocks)
      : grid_(std::move(grid)), blocks_(std::move(blocks)) {}

  std::size_t count() const override { return blocks_.size(); }
  const std::string& path() const override { return grid_; }
  Result<vtkSmartPointer<vtkDataSet>> next() override {
    if (block_ == blocks_.size()) return vtkSmartPointer<vtkDataSet>();
    return std::exchange(blocks_[block_++], nullptr);
  }

 private:
  std::string grid_;
  std::vector<vtkSmartPointer<vtkDataSet>> blocks_;
  std::size_t block_ = 0;  // the next one
};

/// Appends all structured grids of a tree of blocks.
void collect_blocks(vtkMultiBlockDataSet& tree, std::vector<vtkSmartPointer<vtkDataSet>>& blocks) {
  for (unsigned int i = 0; i < tree.GetNumberOfBlocks(); ++i) {
    vtkDataObject* block = tree.GetBlock(i);
    if (auto* grid = vtkStructuredGrid::SafeDownCast(block)) blocks.emplace_back(grid);
    if (auto* branch = vtkMultiBlockDataSet::SafeDownCast(block)) collect_blocks(*branch, blocks);
  }
}

}  // namespace

Result<std::unique_ptr<VtkDataSets>> read_plot3d(const std::string& grid, const std::string& solution) {
  // VTK can guess the variant from the grid's size, but it reads past the end of a truncated file's dimensions.
  SPLATVOL_TRY_ASSIGN(grid_file, open_file(grid));
  SPLATVOL_TRY_ASSIGN(solution_file, open_file(solution));
  SPLATVOL_TRY_ASSIGN(format, detect_plot3d(*grid_file, *solution_file));
  constexpr int pressure = 110;
  std::vector<vtkSmartPointer<vtkDataSet>> blocks;
  SPLATVOL_TRY(run_vtk(grid, [&] {
    const vtkNew<vtkMultiBlockPLOT3DReader> reader;
    reader->SetXYZFileName(grid.c_str());
    reader->SetQFileName(solution.c_str());
    reader->SetMultiGrid(format.multi_grid);
    reader->SetHasByteCount(format.record_marks);
    reader->SetByteOrder(format.big_endian ? vtkMultiBlockPLOT3DReader::FILE_BIG_ENDIAN
                                           : vtkMultiBlockPLOT3DReader::FILE_LITTLE_ENDIAN);
    reader->SetIBlanking(format.blanking);
    reader->SetTwoDimensionalGeometry(format.dimensions == 2);
    reader->SetDoublePrecision(format.precision == 8);
    reader->ForceReadOn();
    reader->AddFunction(pressure);
    reader->Update();
    if (reader->GetOutput()) collect_blocks(*reader->GetOutput(), blocks);
  }));
  if (blocks.empty()) return fail(ErrorCode::invalid_data, "{}: the PLOT3D grid has no blocks", grid);
  return std::make_unique<Plot3dDataSets>(grid, std::move(blocks));
}

}  // namespace splatvol
