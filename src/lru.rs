//! A cache of a few values, of which the one that was not used for longest makes room (least recently used).

/// Values by key, those used last at the end.
#[derive(Debug)]
pub struct Lru<K, V> {
    most: usize,
    all: Vec<(K, V)>,
}

impl<K: PartialEq, V> Lru<K, V> {
    /// None yet, and never more than `most`, at least one.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            all: Vec::new(),
        }
    }

    /// The value for `key`: the one there is, or what `make` makes of the key.
    ///
    /// # Errors
    /// That of `make`.
    pub fn of<E>(&mut self, key: K, make: impl FnOnce(&K) -> Result<V, E>) -> Result<&mut V, E> {
        let kept = match self.all.iter().position(|(k, _)| *k == key) {
            Some(at) => self.all.remove(at),
            None => {
                if self.all.len() >= self.most {
                    self.all.remove(0);
                }
                let value = make(&key)?;
                (key, value)
            }
        };
        self.all.push(kept);
        let (_, value) = self.all.last_mut().expect("one was pushed");
        Ok(value)
    }

    /// What was used last.
    #[cfg(test)]
    pub fn last(&self) -> Option<&(K, V)> {
        self.all.last()
    }

    /// How many there are.
    #[cfg(test)]
    pub fn count(&self) -> usize {
        self.all.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_used_for_longest_makes_room() {
        let mut cache = Lru::new(2);
        let mut made = Vec::new();
        for key in [1, 2, 1, 3, 1, 2] {
            let value = cache.of(key, |k| {
                made.push(*k);
                Ok::<_, ()>(10 * k)
            });
            assert_eq!(value, Ok(&mut (10 * key)));
        }
        assert_eq!(made, [1, 2, 3, 2]);
        assert_eq!((cache.count(), cache.last()), (2, Some(&(2, 20))));
    }

    #[test]
    fn what_cannot_be_made_is_not_kept() {
        let mut cache = Lru::<u32, u32>::new(2);
        assert_eq!(cache.of(1, |_| Err("no")), Err("no"));
        assert_eq!(cache.count(), 0);
    }
}
