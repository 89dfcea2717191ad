// Whole inputs in memory, for tests of sources.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "builder/mesh/tetrahedra.h"
#include "builder/opening/open_own.h"

namespace splatvol::test {

/// All pieces of an input.
struct Input {
  std::vector<std::string> attributes;
  std::optional<TimeStep> step;
  std::vector<Piece> pieces;
  CellCensus census;
  double volume = 0;
  std::size_t points = 0;

  [[nodiscard]] std::size_t index_of(const std::string& attribute) const {
    return static_cast<std::size_t>(std::ranges::find(attributes, attribute) - attributes.begin());
  }
};

/// The largest difference of an attribute from the expected value; NaN if a value is NaN.
inline double largest_error(const Input& input, const std::string& attribute,
                            const std::function<double(dvec3)>& expected) {
  double error = 0;
  for (const Piece& piece : input.pieces)
    for (std::size_t i = 0; i < piece.points.size(); ++i) {
      const double difference = std::abs(piece.values.at(input.index_of(attribute))[i] - expected(piece.points[i]));
      if (!(difference <= error)) error = difference;
    }
  return error;
}

/// The reader process of the programs. Tests of damaged files do not wait for long.
inline ReaderProcessOptions reader_options() {
  return {
      .program = SPLATVOL_BIN "/splatvol-read", .memory = std::uint64_t{2} << 30, .patience = std::chrono::seconds(20)};
}

/// Reads an input as programs do, and checks that its pieces are consistent.
inline Result<Input> read_input(const std::vector<std::string>& paths, const SourceOptions& options = {}) {
  static ReaderProcess reader(reader_options());
  SPLATVOL_TRY_ASSIGN(source, open_safely(reader, paths, options));
  Input input;
  input.attributes = source->attributes();
  input.step = source->time_step();
  for (;;) {
    SPLATVOL_TRY_ASSIGN(piece, source->next());
    if (!piece) break;
    EXPECT_EQ(piece->values.size(), input.attributes.size());
    for (const auto& values : piece->values) EXPECT_EQ(values.size(), piece->points.size());
    for (const auto& [a, b, c, d] : piece->tetrahedra) {
      const auto& p = piece->points;
      EXPECT_LT(std::max({a, b, c, d}), p.size());
      input.volume += std::abs(signed_volume_6(p[a], p[b], p[c], p[d])) / 6;
    }
    input.points += piece->points.size();
    input.census += piece->census;
    input.pieces.push_back(std::move(*piece));
  }
  EXPECT_GE(source->piece_count(), input.pieces.size());
  input.census.left_out += source->left_out_cells();
  return input;
}

/// The error of an input, checked to be one line, or "(no error)".
inline std::string error_of(const std::vector<std::string>& paths, const SourceOptions& options = {}) {
  ::testing::internal::CaptureStderr();
  const auto input = read_input(paths, options);
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "") << "libraries do not print";
  if (input) return "(no error)";
  EXPECT_EQ(input.error().message.find('\n'), std::string::npos) << input.error().message;
  return input.error().message;
}

}  // namespace splatvol::test
