#include "builder/sources/vtk/exodus_reader.h"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkExodusIIReader.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>

#include <algorithm>
#include <optional>

#include "builder/sources/source.h"
#include "builder/sources/vtk/cell_counts.h"
#include "builder/sources/vtk/exodus_file.h"
#include "builder/sources/vtk/hdf5_checks.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/precise_points.h"

namespace splatvol {
namespace {

class ExodusReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    check_hdf5_file(path, Hdf5Arrays::any);  // throws, as the next line does
    header_ = read_exodus_header(path);
    reader_->SetFileName(path.c_str());
    reader_->GenerateObjectIdCellArrayOff();
    return *reader_;
  }

  void select(const std::vector<std::string>& selection) override {
    for (const int type : {vtkExodusIIReader::NODAL, vtkExodusIIReader::ELEM_BLOCK})
      for (int i = 0; i < reader_->GetNumberOfObjectArrays(type); ++i)
        reader_->SetObjectArrayStatus(type, i, wants_array(selection, reader_->GetObjectArrayName(type, i)));
    select_others(false);
  }

  void want_patches() override { wants_patches_ = true; }

  std::vector<ArrayShape> arrays(std::optional<double> /*time*/) override {
    std::vector<ArrayShape> shapes;
    for (const int type : {vtkExodusIIReader::NODAL, vtkExodusIIReader::ELEM_BLOCK})
      for (int i = 0; i < reader_->GetNumberOfObjectArrays(type); ++i)
        shapes.push_back({reader_->GetObjectArrayName(type, i), reader_->GetNumberOfObjectArrayComponents(type, i),
                          type == vtkExodusIIReader::ELEM_BLOCK});
    return shapes;
  }

  std::vector<double> times() const override { return header_.times; }
  int portions() override { return reader_->GetNumberOfObjects(vtkExodusIIReader::ELEM_BLOCK); }

  void read(int portion, std::optional<double> time) override {
    for (int block = 0; block < portions(); ++block)
      reader_->SetObjectStatus(vtkExodusIIReader::ELEM_BLOCK, block, block == portion);
    select_others(wants_patches_ && portion == 0);
    if (time && !header_.times.empty()) {
      reader_->SetTimeStep(static_cast<int>(std::ranges::find(header_.times, *time) - header_.times.begin()));
      time = std::nullopt;
    }
    {
      // Numbers of 4 bytes stay as they are, and so do their sums with displacements.
      std::optional<PrecisePoints> precise;
      if (!header_.single) precise.emplace();
      update(*reader_, time, 0, 1);
    }
    if (auto* block = block_of(reader_->GetOutput())) finish(*block, portion);
  }

 private:
  /// Chooses among all but the blocks of cells: the side sets, or nothing.
  void select_others(bool side_sets) {
    for (const int type : {vtkExodusIIReader::EDGE_BLOCK, vtkExodusIIReader::FACE_BLOCK, vtkExodusIIReader::NODE_SET,
                           vtkExodusIIReader::EDGE_SET, vtkExodusIIReader::FACE_SET, vtkExodusIIReader::SIDE_SET,
                           vtkExodusIIReader::ELEM_SET})
      for (int i = 0; i < reader_->GetNumberOfObjects(type); ++i)
        reader_->SetObjectStatus(type, i, side_sets && type == vtkExodusIIReader::SIDE_SET);
  }

  /// The block of cells in the output: VTK's reader puts all blocks into the first branch.
  static vtkUnstructuredGrid* block_of(vtkMultiBlockDataSet* tree) {
    auto* blocks =
        tree && tree->GetNumberOfBlocks() > 0 ? vtkMultiBlockDataSet::SafeDownCast(tree->GetBlock(0)) : nullptr;
    vtkUnstructuredGrid* block = nullptr;
    for (unsigned int i = 0; blocks && !block && i < blocks->GetNumberOfBlocks(); ++i)
      block = vtkUnstructuredGrid::SafeDownCast(blocks->GetBlock(i));
    return block;
  }

  /// Checks a block that has been read, and takes out values that are none.
  void finish(vtkUnstructuredGrid& grid, int portion) {
    const int id = reader_->GetObjectId(vtkExodusIIReader::ELEM_BLOCK, portion);
    const auto block = header_.blocks.find(id);
    if (block == header_.blocks.end()) return;
    check_nodes(grid, id, block->second);
    remove_missing(vtkExodusIIReader::NODAL, *grid.GetPointData(),
                   [&](int variable) { return header_.has_nodal_values(variable); });
    remove_missing(vtkExodusIIReader::ELEM_BLOCK, *grid.GetCellData(),
                   [&](int variable) { return header_.has_element_values(block->second.number, variable); });
  }

  /// Throws if VTK's reader takes some nodes of the cells only: then it also takes them from the wrong cells. Surfaces
  /// that are left out may be wrong.
  void check_nodes(vtkUnstructuredGrid& grid, int id, const ExodusHeader::Block& block) const {
    if (grid.GetNumberOfCells() == 0 || (!wants_patches_ && is_surface(grid))) return;
    const int type = grid.GetCellType(0);
    const vtkIdType taken = grid.GetCells()->GetCellSize(0);
    if (type == VTK_POLYGON || type == VTK_POLYHEDRON || taken == block.nodes) return;
    throw ReaderError(
        fmt::format("Exodus: cells of block {} have {} nodes ({}), of which VTK's reader would take {}: save them with "
                    "corners only, or with corners and the middles of edges",
                    id, block.nodes, block.type.substr(0, 32), taken));
  }

  /// Takes out the values of variables that the file declares and does not hold. VTK's reader returns leftover memory
  /// for them. Each of its arrays has the next variables as its components.
  template <class HasValues>
  void remove_missing(int type, vtkDataSetAttributes& arrays, const HasValues& has_values) {
    for (int i = 0, variable = 0; i < reader_->GetNumberOfObjectArrays(type); ++i) {
      vtkDataArray* array = arrays.GetArray(reader_->GetObjectArrayName(type, i));
      for (int c = 0; c < reader_->GetNumberOfObjectArrayComponents(type, i); ++c, ++variable)
        if (array && c < array->GetNumberOfComponents() && !has_values(variable))
          array->FillComponent(c, missing_value);
    }
  }

  bool wants_patches_ = false;
  ExodusHeader header_;
  vtkNew<vtkExodusIIReader> reader_;
};

}  // namespace

std::unique_ptr<BlockReader> make_exodus_reader() { return std::make_unique<ExodusReader>(); }

}  // namespace splatvol
