// Breaks the order of the builder's folders in every way that tests/layers.cmake refuses; never compiled.
#include <mpi.h>
#include <vtkDataSet.h>

#include "builder/mesh/moments.h"
#include "builder/sources/source.h"
