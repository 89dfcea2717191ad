// NumPy arrays in and out, without copies.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

#include "splatvol/geometry.h"

namespace splatvol::python {

/// Floating-point numbers of the caller, row by row.
using InArray = nanobind::ndarray<nanobind::ro, nanobind::c_contig, nanobind::device::cpu>;

template <class T>
using OutArray = nanobind::ndarray<nanobind::numpy, T>;

/// Makes an array that owns the elements of a vector. `T`: the number that elements consist of.
template <class T, class Element>
OutArray<T> take(std::vector<Element> elements, std::initializer_list<std::size_t> shape) {
  auto kept = std::make_unique<std::vector<Element>>(std::move(elements));
  auto* numbers = reinterpret_cast<T*>(kept->data());
  const nanobind::capsule owner(kept.get(),
                                [](void* data) noexcept { delete static_cast<std::vector<Element>*>(data); });
  kept.release();
  return OutArray<T>(numbers, shape, owner);
}

/// Of one number for each element.
template <class T>
OutArray<T> take(std::vector<T> elements) {
  const std::size_t count = elements.size();
  return take<T>(std::move(elements), {count});
}

inline OutArray<double> take(std::vector<dvec3> positions) {
  const std::size_t count = positions.size();
  return take<double>(std::move(positions), {count, 3});
}

}  // namespace splatvol::python
