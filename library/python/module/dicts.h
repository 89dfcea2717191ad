// Dictionaries for the package.
#pragma once

#include <nanobind/nanobind.h>

#include <utility>

namespace splatvol::python {

inline void put(nanobind::dict& /*dict*/) {}

template <class Value, class... Rest>
void put(nanobind::dict& dict, const char* name, Value&& value, Rest&&... rest) {
  dict[name] = std::forward<Value>(value);
  put(dict, std::forward<Rest>(rest)...);
}

/// Makes a dictionary: dict_of(name, value, name, value, ...).
template <class... Entries>
nanobind::dict dict_of(Entries&&... entries) {
  nanobind::dict dict;
  put(dict, std::forward<Entries>(entries)...);
  return dict;
}

}  // namespace splatvol::python
