// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <type_traits>

/// Field lists of records: each record is described once, and SQL, JSON and comparison use the same list.
///
/// `fields(visitor, record)` calls `visitor(name, member)` for each member in the order of the list. The name is the
/// JSON key, and storage/rows.h derives the database columns from it. A name ends with its unit. The function is
/// declared in the namespace of the record, so that the visitors find it by argument-dependent lookup.
///
///     SLABD_FIELDS(Spread, median, rms, max);
///
/// A record with names that differ from its members, or with the fields of another record, has an explicit function:
///
///     template <typename V, RecordOf<PoreSummary> R>
///     void fields(V& v, R& r) {
///       SLABD_EACH(r, count, largest_mm)
///       fields(v, r.limits);
///     }
namespace slabd {

template <typename R, typename T>
concept RecordOf = std::same_as<std::remove_const_t<R>, T>;

}  // namespace slabd

#define SLABD_FIELDS(Record, ...)                    \
  template <typename V, ::slabd::RecordOf<Record> R> \
  void fields(V& v, R& r) {                          \
    SLABD_EACH(r, __VA_ARGS__)                       \
  }                                                  \
  static_assert(std::is_class_v<Record>)

/// `v("a", r.a); v("b", r.b); ...` for up to 80 members.
#define SLABD_EACH(r, ...) __VA_OPT__(SLABD_SCAN(SLABD_FIRST(r, __VA_ARGS__)))
#define SLABD_FIRST(r, member, ...) \
  v(#member, r.member);             \
  __VA_OPT__(SLABD_AGAIN SLABD_NONE()(r, __VA_ARGS__))
#define SLABD_NONE
#define SLABD_AGAIN() SLABD_FIRST
#define SLABD_SCAN(...) SLABD_SCAN3(SLABD_SCAN3(SLABD_SCAN3(SLABD_SCAN3(__VA_ARGS__))))
#define SLABD_SCAN3(...) SLABD_SCAN2(SLABD_SCAN2(SLABD_SCAN2(SLABD_SCAN2(__VA_ARGS__))))
#define SLABD_SCAN2(...) SLABD_SCAN1(SLABD_SCAN1(SLABD_SCAN1(SLABD_SCAN1(__VA_ARGS__))))
#define SLABD_SCAN1(...) __VA_ARGS__
