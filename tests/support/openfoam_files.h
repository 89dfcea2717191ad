// Cases of OpenFOAM: a row of unit cubes, with fields.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace splatvol::test {

/// How a case is written.
struct FoamLayout {
  bool binary = false;      // its faces are a faceCompactList
  bool big_endian = false;  // of binary numbers
  int label_bytes = 4;
  int scalar_bytes = 8;
  bool packed = false;                     // all lists and fields by gzip
  std::size_t processors = 0;              // the case is decomposed; 0: it is whole
  std::vector<std::size_t> collated = {};  // folders of the processors: so many in each
  std::string region = {};
};

inline constexpr std::size_t foam_cells = 4;

/// The files of a case by their names. Its cells lie along x; cell i has the values foam_value(i) of "p", three times
/// that of "U", a symmTensor "S" of foam_value(6 i) to foam_value(6 i + 5), and point i has the value i of "h". The
/// step is 0.5. The patches are "left", "right" and "sides".
[[nodiscard]] std::map<std::string, std::string> openfoam_files(const FoamLayout& layout = {});

/// A number with all digits of double precision.
[[nodiscard]] inline double foam_value(std::size_t i) { return (static_cast<double>(i) + 1) / 3; }

/// A file with its header.
[[nodiscard]] std::string foam_file(const std::string& class_name, const std::string& body);

/// Packs a text by gzip.
[[nodiscard]] std::string gzipped(const std::string& text);

}  // namespace splatvol::test
