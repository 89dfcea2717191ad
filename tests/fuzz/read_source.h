// Reads inputs of the builder to their end.
#pragma once

#include <memory>

#include "builder/sources/source.h"
#include "tests/fuzz/fuzz.h"

namespace splatvol::fuzz {

/// Reads all pieces of a source, if it could be opened. Their parts must fit together.
inline void read_all(Result<std::unique_ptr<Source>> source) {
  if (!source) return;
  static_cast<void>((*source)->bounds());
  require((*source)->units().size() == (*source)->attributes().size(), "an attribute has a unit");
  for (;;) {
    const auto piece = (*source)->next();
    if (!piece || !*piece) return;
    const Piece& p = **piece;
    if (!p.lent) require(p.values.size() == (*source)->attributes().size(), "a piece has all attributes");
    for (const auto& values : p.values) require(values.size() == p.points.size(), "a point has a value");
    for (const auto& tetrahedron : p.tetrahedra)
      for (const std::uint32_t corner : tetrahedron) require(corner < p.points.size(), "a corner is a point");
  }
}

}  // namespace splatvol::fuzz
