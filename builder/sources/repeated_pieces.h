// Finds files that repeat the points of another: the steps of a time series, given as if they were pieces.
#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Remembers a fingerprint of each piece: the number of its points, their bounds, a hash of their positions, and a
/// sample of its tetrahedra.
class RepeatedPieces {
 public:
  struct Fingerprint {
    std::string file;
    std::uint64_t points = 0, positions = 0;  // number, hash
    Box box;
    std::vector<std::uint64_t> tetrahedra = {};  // the smallest hashes, sorted
  };
  [[nodiscard]] static Fingerprint fingerprint(std::string file, const Piece& piece);

  /// The same as the next function, for a piece that was read elsewhere.
  [[nodiscard]] Status add(Fingerprint print);

  /// Fails if a piece of another file has the same points in the same order, and shares tetrahedra with this one or
  /// either has none. Pieces of one mesh pass: they share some points only, or all points but no tetrahedra.
  [[nodiscard]] Status add(const std::string& file, const Piece& piece);

 private:
  std::unordered_multimap<std::uint64_t, Fingerprint> seen_;  // by the hash of the positions
};

}  // namespace splatvol
