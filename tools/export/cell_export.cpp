#include "tools/export/cell_export.h"

#include <optional>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/temp_file.h"
#include "extractor/cell_extraction.h"
#include "tools/export/vtu_file.h"

namespace splatvol {
namespace {

static_assert(sizeof(dvec3) == 3 * sizeof(double), "positions are written as they are");

// The corners are the file's first array: they are written before their number is known.
class VtuOutput final : public CellOutput {
 public:
  // `sources`: an empty file, if values are of cells.
  VtuOutput(const CellExtraction& extraction, AtomicFile& file, std::optional<TempFile> sources)
      : file_(file), sources_(std::move(sources)) {
    cell_arrays_ = vtu_.add_cells();
    point_array_ = vtu_.add({.of = VtuArray::Of::points, .name = "Points", .components = 3});
    for (const OutputArray& array : extraction.arrays())
      vtu_.add({.of = extraction.has_cell_values() ? VtuArray::Of::cell_data : VtuArray::Of::point_data,
                .name = array.name,
                .components = array.components(),
                .unit = array.unit});
    vtu_.reserve_header();
  }

  Status write_corners(std::uint64_t first, std::span<const std::uint64_t> corners) override {
    return vtu_.write(file_, cell_arrays_, first, std::as_bytes(corners));
  }
  Status read_corners(std::uint64_t first, std::span<std::uint64_t> corners) override {
    if (!written_) SPLATVOL_TRY_SET(written_, open_file(file_.path_to_write()));
    return written_->read(vtu_.offset(cell_arrays_) + first * sizeof(std::uint64_t), std::as_writable_bytes(corners));
  }
  Status append_sources(std::span<const std::uint64_t> points) override {
    return sources_->append(std::as_bytes(points));
  }
  Status read_sources(std::uint64_t first_cell, std::span<std::uint64_t> points) override {
    return sources_->read(first_cell * sizeof(std::uint64_t), std::as_writable_bytes(points));
  }
  Status set_counts(const CellCounts& counts) override {
    vtu_.set_counts({.points = counts.points, .cells = counts.cells, .corners = counts.corners});
    return {};
  }
  Status write_points(std::uint64_t first, std::span<const dvec3> points) override {
    return vtu_.write(file_, point_array_, first, std::as_bytes(points));
  }
  Status write_values(std::size_t array, std::uint64_t first, std::span<const double> numbers) override {
    return vtu_.write(file_, point_array_ + 1 + array, first, std::as_bytes(numbers));
  }
  Status write_kinds(std::uint64_t first_cell, std::span<const std::uint64_t> ends,
                     std::span<const std::uint8_t> types) override {
    SPLATVOL_TRY(vtu_.write(file_, cell_arrays_ + 1, first_cell, std::as_bytes(ends)));
    return vtu_.write(file_, cell_arrays_ + 2, first_cell, std::as_bytes(types));
  }

  // Completes the file. Returns its bytes.
  Result<std::uint64_t> finish() {
    SPLATVOL_TRY(vtu_.write_frame(file_));
    SPLATVOL_TRY(file_.commit());
    return vtu_.bytes();
  }

 private:
  AtomicFile& file_;
  std::optional<TempFile> sources_;
  std::unique_ptr<ByteSource> written_;  // the file
  VtuFile vtu_;
  std::size_t cell_arrays_ = 0, point_array_ = 0;  // index of the first
};

}  // namespace

Result<CellsReport> export_cells(const format::Volume& volume, const std::string& path,
                                 const format::SplatSelection& selection, const std::function<void(double)>& progress,
                                 Replace replace) {
  SPLATVOL_TRY_ASSIGN(extraction, CellExtraction::open(volume, selection));
  SPLATVOL_TRY(check_vtu_names(volume.name(), names_of(extraction.arrays())));
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  std::optional<TempFile> sources;
  if (extraction.has_cell_values()) SPLATVOL_TRY_SET(sources, TempFile::create(folder_of(path)));
  VtuOutput output(extraction, file, std::move(sources));
  SPLATVOL_TRY_ASSIGN(report, extraction.write(output, progress));
  SPLATVOL_TRY_ASSIGN(bytes, output.finish());
  return CellsReport{report.counts.cells, report.counts.points, report.left_out, report.split, report.volume, bytes};
}

}  // namespace splatvol
