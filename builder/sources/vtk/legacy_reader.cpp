#include "builder/sources/vtk/legacy_reader.h"

#include <vtkDataSet.h>
#include <vtkDataSetReader.h>
#include <vtkNew.h>

#include <utility>
#include <vector>

#include "builder/sources/loaded_data_sets.h"
#include "builder/sources/vtk/data_set.h"
#include "builder/sources/vtk/legacy_checks.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {

Result<std::unique_ptr<DataSets>> open_legacy(const InputFile& file, const SourceOptions& /*options*/) {
  SPLATVOL_TRY_ASSIGN(arrays, legacy_arrays(file.path));
  std::vector<std::unique_ptr<DataSet>> data;
  SPLATVOL_TRY(run_vtk(file.path, [&] {
    const vtkNew<vtkDataSetReader> reader;
    reader->SetFileName(file.path.c_str());
    reader->ReadAllScalarsOn();
    reader->ReadAllVectorsOn();
    reader->ReadAllNormalsOn();
    reader->ReadAllTensorsOn();
    reader->ReadAllColorScalarsOn();
    reader->ReadAllTCoordsOn();
    reader->ReadAllFieldsOn();
    reader->Update();
    if (!reader->GetOutput()) return;
    name_in_utf8(*reader->GetOutput());
    data.push_back(data_set_of(*reader->GetOutput()));
  }));
  if (data.empty()) return fail(ErrorCode::invalid_data, "{}: holds no data set", file.path);
  auto data_sets = std::make_unique<LoadedDataSets>(file.path, std::move(data));
  data_sets->declare(std::move(arrays));
  return data_sets;
}

}  // namespace splatvol
