#include "tools/export/contour_export.h"

#include "extractor/contour_extraction.h"
#include "tools/export/surface_file.h"
#include "tools/export/vtu_file.h"

namespace splatvol {

Result<ContourReport> export_contour(const format::Volume& volume, const std::string& path,
                                     const format::SplatSelection& selection, double value, std::uint64_t memory,
                                     const std::function<void(double)>& progress, Replace replace) {
  const std::vector<OutputArray> arrays = output_arrays(volume.info(), selection);
  SPLATVOL_TRY(check_vtu_names(volume.name(), names_of(arrays)));
  SPLATVOL_TRY_ASSIGN(file, SurfaceFile::create(path, arrays, replace));
  SPLATVOL_TRY_ASSIGN(report, extract_contour(volume, selection, value, memory, *file, progress));
  SPLATVOL_TRY_ASSIGN(bytes, file->finish());
  return ContourReport{report, bytes};
}

}  // namespace splatvol
