// Streamlines of a mesh beside VTK's.
#include <gtest/gtest.h>
#include <vtkCellArray.h>
#include <vtkDataArray.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkStreamTracer.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "sampler/streamlines.h"
#include "tests/sampler/sampled_cells.h"

namespace splatvol::test {
namespace {

constexpr const char* mesh = SPLATVOL_SHARED "/data/bluntfin.vtu";

struct BesideVtk : SampledCells {};

// Follows one seed against the vectors and with them: the polylines that VTK finds, by tiny steps.
std::vector<std::vector<dvec3>> lines_of_vtk(vtkUnstructuredGrid* grid, const dvec3& seed, double length) {
  vtkNew<vtkStreamTracer> tracer;
  tracer->SetInputData(grid);
  tracer->SetInputArrayToProcess(0, 0, 0, 0, "Momentum");
  tracer->SetStartPosition(seed.x, seed.y, seed.z);
  tracer->SetIntegratorTypeToRungeKutta45();
  tracer->SetIntegrationDirectionToBoth();
  tracer->SetIntegrationStepUnit(vtkStreamTracer::CELL_LENGTH_UNIT);
  tracer->SetInitialIntegrationStep(0.02);
  tracer->SetMinimumIntegrationStep(1e-4);
  tracer->SetMaximumIntegrationStep(0.02);
  tracer->SetMaximumError(1e-9);
  tracer->SetMaximumPropagation(length);
  tracer->SetMaximumNumberOfSteps(1'000'000);
  tracer->Update();
  vtkPolyData* const found = tracer->GetOutput();
  std::vector<std::vector<dvec3>> lines;
  vtkNew<vtkIdList> ids;
  for (vtkIdType cell = 0; cell < found->GetNumberOfCells(); ++cell) {
    found->GetCellPoints(cell, ids);
    std::vector<dvec3>& line = lines.emplace_back();
    for (vtkIdType i = 0; i < ids->GetNumberOfIds(); ++i) {
      dvec3 at;
      found->GetPoint(ids->GetId(i), &at.x);
      line.push_back(at);
    }
  }
  return lines;
}

double distance_from(const std::vector<dvec3>& line, const dvec3& position) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < line.size(); ++i) {
    const dvec3 way = line[i] - line[i - 1], offset = position - line[i - 1];
    const double square = squared_length(way);
    const double share = square > 0 ? std::clamp(glm::dot(offset, way) / square, 0.0, 1.0) : 0;
    nearest = std::min(nearest, glm::length(offset - share * way));
  }
  return nearest;
}

// VTK ends a line a step before the mesh does. Each of its points is on our line, whose chords are as long as cells.
TEST_F(BesideVtk, OfTheSharedMeshAreTheSame) {
  if (!std::filesystem::exists(mesh)) GTEST_SKIP() << "no " << mesh;
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(mesh);
  reader->Update();
  build_input(mesh, path("mesh.svol"), exact());
  open("mesh.svol");
  const std::vector<Streamline> ours =
      value_of(find_streamlines(*volume_, {.vector = "Momentum", .seeds = SeedLine{{-4, 1, 0.5}, {-4, 6, 4}, 10}},
                                usual_streamline_bytes, 2))
          .lines;
  for (const Streamline& line : ours) {
    const dvec3 seed =
        line.positions[static_cast<std::size_t>(std::ranges::find(line.times, 0.0) - line.times.begin())];
    const auto theirs = lines_of_vtk(reader->GetOutput(), seed, 100);
    ASSERT_EQ(theirs.size(), 2);
    std::vector<dvec3> joined(theirs[1].rbegin(), theirs[1].rend());
    joined.insert(joined.end(), theirs[0].begin(), theirs[0].end());
    double largest = 0, sum = 0;
    for (const dvec3& p : line.positions) {
      const double distance = distance_from(joined, p);
      if (glm::length(p - line.positions.front()) > 0.5 && glm::length(p - line.positions.back()) > 0.5)
        largest = std::max(largest, distance), sum += distance;
    }
    EXPECT_LT(largest, 0.005) << line.seed;
    EXPECT_LT(sum / static_cast<double>(line.positions.size()), 0.0005);
  }
}

}  // namespace
}  // namespace splatvol::test
