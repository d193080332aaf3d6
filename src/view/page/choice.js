// What is chosen: what outlines show in the picture and the table, and what marking, painting and leaving out work on.
// It is a list of ids, and the condition that made it if there is one.

export class Choice {
  constructor() {
    this.ids = new Set();
    this.where = null;
    this.listeners = [];
  }

  onChange(listener) {
    this.listeners.push(listener);
  }

  /** `from` tells listeners who chose, so that a list does not scroll under the hand. */
  set(ids, { where = null, from = null } = {}) {
    if (this.ids.size === 0 && ids.length === 0) return;
    this.ids = new Set(ids);
    this.where = where;
    for (const listener of this.listeners) listener(from);
  }

  toggle(id, from) {
    const ids = new Set(this.ids);
    if (!ids.delete(id)) ids.add(id);
    this.set([...ids], { from });
  }

  clear(from = null) {
    this.set([], { from });
  }

  /** What a rule of the state says of it. */
  rule() {
    if (this.where !== null) return { where: this.where };
    return { ids: [...this.ids].sort((a, b) => a - b) };
  }
}
