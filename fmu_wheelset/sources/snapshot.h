/* Copies of a component: to go back to, or to keep as bytes. */
#ifndef SNAPSHOT_H
#define SNAPSHOT_H

#include "component.h"

/* Into *snapshot, which is allocated if it is 0. */
Status snapshot_take(Instance *instance, void **snapshot);
Status snapshot_restore(Instance *instance, const void *snapshot);
Status snapshot_free(void **snapshot);

/* As bytes; they are read by the same build of this FMU only. */
Status snapshot_size(Instance *instance, const void *snapshot, size_t *size);
Status snapshot_write(Instance *instance, const void *snapshot, void *bytes, size_t size);
Status snapshot_read(Instance *instance, const void *bytes, size_t size, void **snapshot);

#endif
