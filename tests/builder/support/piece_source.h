// A source whose pieces are in memory, for the builder's tests.
#pragma once

#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "builder/sources/source.h"
#include "tests/builder/support/meshes.h"
#include "tests/support/random.h"

namespace splatvol::test {

/// What a PieceSource tells of itself. Without `bounds`, bounds() tells nothing.
struct PieceSourceTraits {
  std::vector<std::string> attributes = {"value"};
  bool bounds = false, single_precision = false, averages_by_piece = false, brings_material = false;
  VertexCopies copies = VertexCopies::same_values;
};

class PieceSource : public Source {
 public:
  explicit PieceSource(std::vector<Piece> pieces, PieceSourceTraits traits = {})
      : pieces_(std::move(pieces)), traits_(std::move(traits)) {}
  const std::vector<std::string>& attributes() const override { return traits_.attributes; }
  std::size_t piece_count() const override { return pieces_.size(); }
  Result<std::unique_ptr<Piece>> next() override {
    if (next_ == pieces_.size()) return nullptr;
    return std::make_unique<Piece>(pieces_[next_++]);
  }
  Result<std::optional<Box>> bounds() override {
    if (!traits_.bounds) return std::optional<Box>();
    Box box;
    for (const Piece& piece : pieces_)
      for (const dvec3& p : piece.points)
        if (std::isfinite(p.x + p.y + p.z)) box.include({p, p});
    return box;
  }
  bool single_precision() const override { return traits_.single_precision; }
  bool averages_by_piece() const override { return traits_.averages_by_piece; }
  bool brings_material() const override { return traits_.brings_material; }
  VertexCopies copies() const override { return traits_.copies; }

 private:
  std::vector<Piece> pieces_;
  PieceSourceTraits traits_;
  std::size_t next_ = 0;
};

/// Points without cells, of the value x + 2 y.
inline Piece scattered(std::vector<dvec3> points) {
  Piece piece;
  piece.points = std::move(points);
  piece.values.resize(1);
  for (const dvec3& p : piece.points) piece.values[0].push_back(p.x + 2 * p.y);
  return piece;
}

inline Piece mesh_piece(const Mesh& mesh, const std::function<double(dvec3)>& field) {
  Piece piece;
  piece.points = mesh.points;
  piece.values = {sample(mesh, field)};
  piece.tetrahedra = mesh.tetrahedra;
  piece.census.tetrahedra = mesh.tetrahedra.size();
  return piece;
}

/// Cuts the cells of a mesh into `count` pieces, each with points of its own. Leaves out points that no cell uses.
inline std::vector<Piece> cut(const Piece& whole, std::size_t count) {
  std::vector<Piece> pieces(count);
  const std::size_t cells = whole.tetrahedra.size();
  for (std::size_t part = 0; part < count; ++part) {
    std::map<std::uint32_t, std::uint32_t> renumbered;
    Piece& piece = pieces[part];
    piece.values.resize(whole.values.size());
    for (std::size_t t = part * cells / count; t < (part + 1) * cells / count; ++t) {
      Tetrahedron corners = whole.tetrahedra[t];
      for (std::uint32_t& v : corners) {
        const auto [found, added] = renumbered.try_emplace(v, static_cast<std::uint32_t>(renumbered.size()));
        if (added) {
          piece.points.push_back(whole.points[v]);
          for (std::size_t a = 0; a < whole.values.size(); ++a) piece.values[a].push_back(whole.values[a][v]);
        }
        v = found->second;
      }
      piece.tetrahedra.push_back(corners);
    }
    piece.census.tetrahedra = piece.tetrahedra.size();
  }
  return pieces;
}

/// Uniform in a cube.
inline std::vector<dvec3> random_points(std::size_t count, double scale = 1, dvec3 offset = dvec3(0)) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<dvec3> points(count);
  for (dvec3& p : points) p = offset + scale * random_vector(uniform, random);
  return points;
}

}  // namespace splatvol::test
