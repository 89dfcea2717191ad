// Breaks a rule that tests/layers.cmake checks: `format` has no threads and no locks; never compiled.
#include <mutex>
