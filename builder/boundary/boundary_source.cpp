#include "builder/boundary/boundary_source.h"

namespace splatvol {

Result<std::unique_ptr<Piece>> BoundarySource::next() {
  SPLATVOL_TRY_ASSIGN(piece, source_.next());
  if (!piece) return piece;
  SPLATVOL_TRY(faces_.add(*piece));
  piece->patches = {};
  return piece;
}

}  // namespace splatvol
