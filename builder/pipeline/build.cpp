#include "builder/pipeline/build.h"

#include <algorithm>
#include <optional>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/interruption.h"
#include "base/names.h"
#include "builder/pipeline/checking.h"
#include "builder/pipeline/reduce_source.h"
#include "builder/pipeline/store_boundary.h"
#include "builder/pipeline/store_cells.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

// Returns the file's size in bytes. `boundary`: null if the file gets none.
Result<std::uint64_t> write(AtomicFile file, ReducedSource reduced, StoredBoundary* boundary,
                            format::WriteCells write_cells, const std::string& folder, const BuildProgress& progress) {
  if (boundary) reduced.info.boundary = boundary->packed.info;
  SPLATVOL_TRY_ASSIGN(index, pack_index(reduced, folder));
  SPLATVOL_TRY_ASSIGN(writer, format::VolumeWriter::create(std::move(file), reduced.files.coarse_bytes(), reduced.info,
                                                           std::move(index), folder));
  if (boundary) writer->set_boundary(std::move(boundary->packed.section));
  if (write_cells) writer->set_cells(std::move(write_cells));
  std::uint64_t row = 0;
  const auto append = [&](std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) -> Status {
    SPLATVOL_TRY(check_interruption());
    progress("writing", static_cast<double>(++row) / static_cast<double>(writer->rows().row_count()));
    return bytes.empty() ? writer->add_written_row(entries) : writer->append_row(entries, bytes);
  };
  SPLATVOL_TRY(reduced.files.read(reduced.info.resolutions(), append));
  SPLATVOL_TRY(writer->finish(reduced.histograms, checking(progress)));
  return writer->file_bytes();
}

}  // namespace

const char* connectivity_name(Connectivity connectivity) {
  switch (connectivity) {
    case Connectivity::mesh:
      return "mesh";
    case Connectivity::delaunay:
      return "delaunay";
    case Connectivity::boxes:
      return "boxes";
    case Connectivity::none:
      return "none";
    default:
      return "auto";
  }
}

Result<Connectivity> parse_connectivity(const std::string& name) {
  for (const Connectivity connectivity :
       {Connectivity::automatic, Connectivity::mesh, Connectivity::delaunay, Connectivity::none, Connectivity::boxes})
    if (name == connectivity_name(connectivity)) return connectivity;
  return fail(ErrorCode::invalid_argument, "connectivity \"{}\": take auto, mesh, delaunay, none or boxes", name);
}

Status check_units(const Source& source, const BuildOptions& options) {
  for (const auto& [name, unit] : options.units)
    if (std::ranges::find(source.attributes(), name) == source.attributes().end())
      return fail_no_attribute("unit " + unit, name, source.attributes());
  return {};
}

// A folder with room for the file has room for parts of it.
std::string temp_folder_of(const std::string& output, const BuildOptions& options) {
  return options.temp_folder.empty() ? folder_of(output) : options.temp_folder;
}

Result<BuildReport> build_from_points(PointStream points, AtomicFile file, const std::string& folder,
                                      const BuildOptions& options, const BuildProgress& progress, BoundaryFaces* faces,
                                      MeshCells* cells) {
  RowFiles files(folder, file);
  std::uint64_t bytes = 0;
  std::optional<StoredBoundary> boundary;
  std::optional<CellReport> kept;
  const auto finish = [&](ReducedSource reduced) -> Status {
    if (faces) {
      SPLATVOL_TRY_ASSIGN(stored, finish_boundary(*faces, options, progress));
      boundary.emplace(std::move(stored));
    }
    format::WriteCells add_cells;
    if (reduced.cells) {
      progress("sorting cells", 0);
      SPLATVOL_TRY(reduced.cells->sort());
      if (reduced.cells->count() == 0) reduced.cells = nullptr;
    }
    if (reduced.cells) {
      reduced.info.cells = format::CellsInfo{reduced.cells->hash()};
      add_cells = [&](const std::shared_ptr<const format::ChunkSource>& chunks,
                      const format::AppendBytes& append) -> Status {
        const auto write = [&](double fraction) { progress("writing cells", fraction); };
        SPLATVOL_TRY_SET(kept, write_cells(*cells, chunks, options.memory / 4, folder, append, write));
        return {};
      };
    }
    SPLATVOL_TRY_SET(bytes, write(std::move(file), std::move(reduced), boundary ? &*boundary : nullptr,
                                  std::move(add_cells), folder, progress));
    return {};
  };
  SPLATVOL_TRY_ASSIGN(report, reduce_points(std::move(points), options, files, folder, progress, finish, cells));
  report.file_bytes = bytes;
  report.kept_cells = kept;
  if (!boundary) return report;
  report.boundary = std::move(boundary->report);
  report.least_memory = std::max(report.least_memory, boundary->held_bytes);
  return report;
}

Result<BuildReport> build_volume(Source& source, const std::string& output, const BuildOptions& options,
                                 const BuildProgress& progress) {
  SPLATVOL_TRY(check_units(source, options));
  // If the file cannot be written, this fails before the work.
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(output));
  const std::string folder = temp_folder_of(output, options);
  SPLATVOL_TRY(check_reduction(options));
  const auto read = [&](double fraction) { progress("reading", fraction); };
  SPLATVOL_TRY_ASSIGN(faces, start_boundary(source, options, folder));
  SPLATVOL_TRY_ASSIGN(cells, start_cells(source, options, folder));
  SPLATVOL_TRY_ASSIGN(
      points, PointStream::create(source, uses_cells(options), options.memory / 2, folder, read, options.gradients,
                                  joined_attributes(options), watch_points(source, options, faces.get(), cells.get())));
  SPLATVOL_TRY(check_boundary(faces, options));
  return build_from_points(std::move(points), std::move(file), folder, options, progress, faces.get(), cells.get());
}

}  // namespace splatvol
