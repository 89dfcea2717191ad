// Files, opened and read by tests.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/file.h"
#include "format/cell_reader.h"
#include "format/volume.h"
#include "tests/support/results.h"

namespace splatvol::test {

/// Opens a file, and checks all of it.
inline std::shared_ptr<const format::Volume> open_checked(const std::string& path) {
  auto volume = value_of(format::Volume::open(value_of(open_file(path))));
  EXPECT_EQ(message_of(volume->verify([](double) {}, 2)), "") << path;
  return volume;
}

/// All chunks of cells of a file.
inline std::vector<format::CellChunk> chunks_of(const format::CellReader& cells) {
  std::vector<format::CellChunk> chunks;
  for (std::size_t page = 0; page < cells.pages().size(); ++page)
    for (const format::CellChunkEntry& entry : value_of(cells.read_page(page, {})).chunks)
      chunks.push_back(value_of(cells.read_chunk(entry)));
  return chunks;
}

}  // namespace splatvol::test
