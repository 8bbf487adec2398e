// The types of BSON and the helpers that MongoDB's JavaScript has. Evaluates to functions for the host.
(function () {
  'use strict';

  const hide = (object, name, value) => Object.defineProperty(object, name, { value });
  const type = (constructor, tag, methods) => {
    hide(constructor.prototype, '__bson', tag);
    hide(constructor.prototype, Symbol.toStringTag, constructor.name);
    Object.keys(methods).forEach((name) => hide(constructor.prototype, name, methods[name]));
    globalThis[constructor.name] = constructor;
  };

  function NumberLong(value) {
    if (!new.target) return new NumberLong(value);
    const whole = typeof value === 'number' ? Math.trunc(value) : String(value === undefined ? 0 : value);
    hide(this, 'text', BigInt.asIntN(64, BigInt(whole)).toString());
  }
  type(NumberLong, 'long', {
    valueOf() { return Number(this.text); },
    toNumber() { return Number(this.text); },
    toString() { return 'NumberLong(' + (Number.isSafeInteger(Number(this.text)) ? this.text : JSON.stringify(this.text)) + ')'; },
    toJSON() { return this.toString(); },
  });

  function NumberInt(value) {
    if (!new.target) return new NumberInt(value);
    hide(this, 'text', String(Number(value === undefined ? 0 : value) | 0));
  }
  type(NumberInt, 'int', {
    valueOf() { return Number(this.text); },
    toNumber() { return Number(this.text); },
    toString() { return 'NumberInt(' + this.text + ')'; },
    toJSON() { return Number(this.text); },
  });

  function NumberDecimal(value) {
    if (!new.target) return new NumberDecimal(value);
    hide(this, 'text', String(value === undefined ? 0 : value));
  }
  type(NumberDecimal, 'decimal', {
    toString() { return 'NumberDecimal(' + JSON.stringify(this.text) + ')'; },
    toJSON() { return { $numberDecimal: this.text }; },
  });

  function ObjectId(value) {
    if (!new.target) return new ObjectId(value);
    if (!/^[0-9a-fA-F]{24}$/.test(value)) throw new Error('an ObjectId is written with 24 hexadecimal digits');
    hide(this, 'str', String(value).toLowerCase());
  }
  type(ObjectId, 'id', {
    valueOf() { return this.str; },
    toString() { return 'ObjectId("' + this.str + '")'; },
    toJSON() { return { $oid: this.str }; },
    equals(other) { return other instanceof ObjectId && other.str === this.str; },
    getTimestamp() { return new Date(parseInt(this.str.slice(0, 8), 16) * 1000); },
  });

  function BinData(subtype, base64) {
    if (!new.target) return new BinData(subtype, base64);
    hide(this, 'subtype', Number(subtype));
    hide(this, 'text', String(base64));
  }
  type(BinData, 'binary', {
    base64() { return this.text; },
    toString() { return 'BinData(' + this.subtype + ',"' + this.text + '")'; },
    toJSON() { return { $binary: this.text, $type: this.subtype.toString(16).padStart(2, '0') }; },
  });

  function Timestamp(time, increment) {
    if (!new.target) return new Timestamp(time, increment);
    hide(this, 't', Number(time) >>> 0);
    hide(this, 'i', Number(increment) >>> 0);
  }
  type(Timestamp, 'timestamp', {
    getTime() { return this.t; },
    getInc() { return this.i; },
    toString() { return 'Timestamp(' + this.t + ', ' + this.i + ')'; },
    toJSON() { return { $timestamp: { t: this.t, i: this.i } }; },
  });

  function MinKey() { if (!new.target) return new MinKey(); }
  type(MinKey, 'min', { toJSON() { return { $minKey: 1 }; } });
  function MaxKey() { if (!new.target) return new MaxKey(); }
  type(MaxKey, 'max', { toJSON() { return { $maxKey: 1 }; } });

  function Code(text) { hide(this, 'text', String(text)); }
  hide(Code.prototype, '__bson', 'code');

  globalThis.ISODate = (text) => (text === undefined ? new Date() : new Date(text));
  globalThis.print = () => undefined;
  globalThis.printjson = () => undefined;
  globalThis.tojson = (value, indent, oneLine) => {
    if (value === undefined) return 'undefined';
    if (typeof value === 'function') return value.toString();
    return JSON.stringify(value, null, oneLine ? 0 : '\t');
  };
  globalThis.tojsononeline = (value) => globalThis.tojson(value, '', true);
  globalThis.isNumber = (value) => typeof value === 'number' || value instanceof Number;
  globalThis.isString = (value) => typeof value === 'string';
  globalThis.isObject = (value) => value instanceof Object;
  globalThis.version = () => '6.0.0';
  globalThis.assert = (condition, message) => {
    if (!condition) throw new Error('assert failed' + (message === undefined ? '' : ' : ' + message));
  };
  hide(Array, 'sum', (items) => (items.length === 0 ? null : items.reduce((sum, item) => sum + item)));
  hide(Array, 'avg', (items) => (items.length === 0 ? null : Array.sum(items) / items.length));
  hide(Array, 'contains', (items, item) => items.includes(item));
  hide(Array, 'unique', (items) => [...new Set(items)]);

  const compile = (source) => (0, eval)(source);
  return {
    long: (text) => new NumberLong(text),
    decimal: (text) => new NumberDecimal(text),
    id: (text) => new ObjectId(text),
    binary: (subtype, text) => new BinData(subtype, text),
    timestamp: (time, increment) => new Timestamp(time, increment),
    min: () => new MinKey(),
    max: () => new MaxKey(),
    date: (millis) => new Date(millis),
    regex: (pattern, options) => {
      try { return new RegExp(pattern, options.replace(/[^imsu]/g, '')); } catch (error) { return new Code('/' + pattern + '/'); }
    },
    code: (text) => { try { return compile('(' + text + '\n)'); } catch (error) { return new Code(text); } },
    // The type of an object and its parts, as texts.
    parts: (value) => {
      if (Array.isArray(value)) return ['array'];
      if (value instanceof Date) return ['date', String(value.getTime())];
      if (value instanceof RegExp) return ['regex', value.source, value.flags.replace(/[^imsu]/g, '')];
      if (typeof value === 'function') return ['code', value.toString()];
      if (value instanceof Number || value instanceof String || value instanceof Boolean) return ['plain'];
      switch (value.__bson) {
        case 'id': return ['id', value.str];
        case 'binary': return ['binary', String(value.subtype), value.text];
        case 'timestamp': return ['timestamp', String(value.t), String(value.i)];
        case 'min': case 'max': return [value.__bson];
        case 'long': case 'int': case 'decimal': case 'code': return [value.__bson, value.text];
        default: return ['document'];
      }
    },
    plain: (value) => value.valueOf(),
  };
})()
