// Points of double precision from readers of VTK that make those of single precision.
#pragma once

#include <vtkSmartPointer.h>

class vtkObjectFactory;

namespace splatvol {

/// While one of these is there, VTK makes points of double precision instead of single. For readers that hold
/// coordinates in double precision up to this step. Not thread-safe.
class PrecisePoints {
 public:
  PrecisePoints();
  ~PrecisePoints();
  PrecisePoints(const PrecisePoints&) = delete;
  PrecisePoints& operator=(const PrecisePoints&) = delete;

 private:
  vtkSmartPointer<vtkObjectFactory> factory_;
};

}  // namespace splatvol
