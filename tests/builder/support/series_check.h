// Compares the steps of a series with files that are built from one step each.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/series/series_build.h"
#include "builder/series/series_inputs.h"
#include "format/volume.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"

namespace splatvol::test {

/// A step of a series, of pieces in memory.
inline SeriesStep step_of(const std::string& name, std::optional<double> time, std::vector<Piece> pieces,
                          PieceSourceTraits traits = {}) {
  const auto open = [pieces = std::move(pieces), traits = std::move(traits)]() -> Result<std::unique_ptr<Source>> {
    return std::make_unique<PieceSource>(pieces, traits);
  };
  return {name, time, open};
}

/// Returns every chunk of a file at its step, packed, by row and column.
inline std::vector<format::Bytes> chunks_of(const format::Volume& volume) {
  std::vector<format::Bytes> chunks;
  const format::RowLayout& rows = volume.rows();
  for (std::uint64_t row = 0; row < rows.row_count(); ++row)
    for (const int column : rows.columns_of_row(row)) {
      const auto page = volume.read_directory_page(volume.directory_page_of_row(row, column)).value();
      const format::ChunkLocation& location = volume.find_chunk(page, row, column);
      chunks.push_back(volume.read_bytes(location.offset, location.entry.packed_bytes).value());
    }
  return chunks;
}

/// Expects that an input has `steps` steps, and that each is, in a series of all, as in a file that is built at its
/// time. `folder`: for these files. `attributes`: empty for all.
inline void expect_series(const std::string& input, const std::string& folder, std::size_t steps,
                          const std::vector<std::string>& attributes = {}) {
  const auto silent = [](const char*, double) {};
  const std::string path = folder + "/all-steps.svol", single_path = folder + "/single.svol";
  auto list =
      value_of(steps_of_input({input}, {attributes, {}, {}}, parse_times("all").value(), {open_source, list_arrays}));
  ASSERT_EQ(list.size(), steps);
  const auto built = value_of(build_series(std::move(list), path, {}, silent));
  const auto series = format::Volume::open(open_file(path).value()).value();
  EXPECT_EQ(message_of(series->verify([](double) {})), "");
  for (std::size_t step = 0; step < steps; ++step) {
    const auto source = value_of(open_source({input}, {attributes, {}, built.times[step]}));
    const BuildOptions apart{.join_attributes = false};  // as in a series
    ASSERT_TRUE(build_volume(*source, single_path, apart, silent));
    const auto single = format::Volume::open(open_file(single_path).value()).value();
    const auto at_step = series->at_step(step).value();
    EXPECT_EQ(at_step->time(), built.times[step]);
    for (std::size_t a = 0; a < single->info().attributes.size(); ++a)
      EXPECT_EQ(at_step->info().attributes[a].name, single->info().attributes[a].name);
    EXPECT_EQ(at_step->info().resolution_counts, single->info().resolution_counts) << input << ", step " << step;
    EXPECT_TRUE(chunks_of(*at_step) == chunks_of(*single)) << input << ", step " << step;
  }
  std::filesystem::remove(path);
  std::filesystem::remove(single_path);
}

}  // namespace splatvol::test
