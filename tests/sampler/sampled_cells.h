// Files of cells in a folder of their own.
#pragma once

#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "base/file.h"
#include "sampler/cell_sampler.h"
#include "tests/builder/support/built_input.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/builder/support/mesh_of_shapes.h"
#include "tests/support/random.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

// Single precision has the values.
inline double field(const dvec3& p) { return double{static_cast<float>(std::sin(5 * p.x) + p.y * p.z)}; }

struct SampledCells : FolderTest {
  [[nodiscard]] static BuildOptions exact() {
    return {.exact = {.positions = true, .values = true}, .keep_cells = true};
  }

  void build(const Piece& piece, const BuildOptions& options = exact()) {
    PieceSource source({piece}, {.attributes = {"value"}});
    ASSERT_EQ(message_of(build_volume(source, path("mesh.svol"), options, [](const char*, double) {})), "");
    open("mesh.svol");
  }

  using Fields = std::vector<std::function<double(dvec3)>>;

  // `names`: of the attributes.
  void build_fields(const Mesh& mesh, const Fields& fields, const std::vector<std::string>& names = {"value", "other"},
                    const BuildOptions& options = exact()) {
    Piece piece = mesh_piece(mesh, fields[0]);
    for (std::size_t a = 1; a < fields.size(); ++a) piece.values.push_back(mesh_piece(mesh, fields[a]).values[0]);
    PieceSource source({piece}, {.attributes = {names.begin(), names.begin() + std::ssize(fields)}});
    ASSERT_EQ(message_of(build_volume(source, path("mesh.svol"), options, [](const char*, double) {})), "");
    open("mesh.svol");
  }

  void open(const std::string& name) { volume_ = value_of(format::Volume::open(*open_file(path(name)))); }

  [[nodiscard]] std::unique_ptr<const CellTetrahedra> cells(std::uint64_t memory = 1 << 24) const {
    return value_of(CellTetrahedra::open(*volume_, {0}, own_room(memory)));
  }
  [[nodiscard]] std::vector<double> sample(const std::vector<dvec3>& positions, std::uint64_t memory = 1 << 24) const {
    return value_of(sample_cells(*cells(memory), positions));
  }

  std::vector<dvec3> random_positions(std::size_t count, double low, double high) {
    std::uniform_real_distribution<double> uniform(low, high);
    std::vector<dvec3> positions;
    for (std::size_t i = 0; i < count; ++i) positions.push_back(random_vector(uniform, random_));
    return positions;
  }

  std::mt19937_64 random_{7};
  std::shared_ptr<const format::Volume> volume_;
};

}  // namespace splatvol::test
